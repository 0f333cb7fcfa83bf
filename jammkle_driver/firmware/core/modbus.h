/* Modbus RTU server after "MODBUS Application Protocol Specification V1.1b3" and "MODBUS over Serial Line V1.02". */
#ifndef JAMMKLE_MODBUS_H
#define JAMMKLE_MODBUS_H

#include <stdbool.h>
#include <stdint.h>

enum { MODBUS_FRAME_MAX = 256 };

/* Exception codes (application protocol, chapter 7); 0 stands for none. */
enum {
    MODBUS_OK = 0,
    MODBUS_ILLEGAL_FUNCTION = 1,
    MODBUS_ILLEGAL_ADDRESS = 2,
    MODBUS_ILLEGAL_VALUE = 3,
    MODBUS_DEVICE_FAILURE = 4,
    MODBUS_DEVICE_BUSY = 6
};

typedef struct {
    uint8_t frame[MODBUS_FRAME_MAX]; /* what comes in, then the reply to it */
    uint16_t length;
    bool damaged; /* too long, or a byte of it was received with an error */
    uint8_t address;
    uint32_t silence_us; /* 3.5 characters: the end of a frame */
    uint32_t last_byte_us;
    uint16_t check_sum_errors;
    uint16_t frames;
} modbus_server;

void modbus_init(modbus_server *server, uint8_t address, uint32_t baud);

/* Take one byte; `intact` is false if framing or overrun spoiled it. */
void modbus_take(modbus_server *server, uint8_t byte, bool intact, uint32_t now_us);

/* Once a frame has ended, carry it out; return the length of the reply in `frame`, 0 for none. */
uint16_t modbus_poll(modbus_server *server, uint32_t now_us);

uint16_t modbus_crc(const uint8_t *data, uint16_t length);

/* What stands behind the registers. Each returns an exception code. Writes are taken whole or not at all. */
uint8_t map_read_bit(bool coil, uint16_t address, bool *value);
uint8_t map_read_register(bool input, uint16_t address, uint16_t *value);
uint8_t map_write_coils(uint16_t address, uint16_t count, const uint8_t *packed);
uint8_t map_write_registers(uint16_t address, uint16_t count, const uint8_t *big_endian);

#endif
