#include "modbus.h"

enum {
    READ_COILS = 1,
    READ_DISCRETE_INPUTS = 2,
    READ_HOLDING_REGISTERS = 3,
    READ_INPUT_REGISTERS = 4,
    WRITE_COIL = 5,
    WRITE_REGISTER = 6,
    DIAGNOSTICS = 8,
    WRITE_COILS = 15,
    WRITE_REGISTERS = 16,
    READ_WRITE_REGISTERS = 23
};

enum {
    BROADCAST = 0,
    CRC_LENGTH = 2,
    FRAME_MIN = 4, /* address, function, check sum */
    BITS_READ_MAX = 2000,
    BITS_WRITE_MAX = 1968,
    REGISTERS_READ_MAX = 125,
    REGISTERS_WRITE_MAX = 123,
    REGISTERS_READ_WRITE_MAX = 121
};

#define COIL_ON 0xFF00u
#define EXCEPTION_FLAG 0x80u

/* Above 19200 baud the standard fixes the silence (serial line V1.02, 2.5.1.1); a character has 11 bits. */
#define FAST_BAUD 19200u
#define FAST_SILENCE_US 1750u
#define CHARACTER_BITS 11u

static uint16_t word_at(const uint8_t *bytes)
{
    return (uint16_t)((uint16_t)(bytes[0] << 8) | bytes[1]);
}

static void put_word(uint8_t *bytes, uint16_t word)
{
    bytes[0] = (uint8_t)(word >> 8);
    bytes[1] = (uint8_t)word;
}

/* CRC-16 with the reflected polynomial 0xA001 (serial line V1.02, 6.2.2). */
uint16_t modbus_crc(const uint8_t *data, uint16_t length)
{
    uint16_t crc = 0xFFFFu;
    for (uint16_t i = 0; i < length; i++) {
        crc ^= data[i];
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = (crc & 1u) ? (uint16_t)((crc >> 1) ^ 0xA001u) : (uint16_t)(crc >> 1);
    }
    return crc;
}

void modbus_init(modbus_server *server, uint8_t address, uint32_t baud)
{
    server->length = 0;
    server->damaged = false;
    server->address = address;
    server->silence_us = baud > FAST_BAUD ? FAST_SILENCE_US : CHARACTER_BITS * 3500000u / baud;
    server->last_byte_us = 0;
    server->check_sum_errors = 0;
    server->frames = 0;
}

/* Gaps inside a frame are not looked at, although the standard wants a frame with a gap of 1.5 characters thrown away:
 * USB adapters make such gaps, and the check sum tells a frame that was cut. */
void modbus_take(modbus_server *server, uint8_t byte, bool intact, uint32_t now_us)
{
    server->last_byte_us = now_us;
    if (!intact || server->length >= MODBUS_FRAME_MAX) {
        server->damaged = true;
        return;
    }
    server->frame[server->length++] = byte;
}

/* The requests below find their data from frame[2] on and put their reply there; `size` is that of the data, which a
 * reply replaces by its own. */

static uint8_t read_bits(uint8_t *data, uint16_t *size, bool coils)
{
    if (*size != 4)
        return MODBUS_ILLEGAL_VALUE;
    uint16_t first = word_at(data), count = word_at(data + 2);
    if (count < 1 || count > BITS_READ_MAX)
        return MODBUS_ILLEGAL_VALUE;
    uint8_t bytes = (uint8_t)((count + 7u) / 8u);
    for (uint8_t i = 0; i < bytes; i++)
        data[1 + i] = 0;
    for (uint16_t i = 0; i < count; i++) {
        bool value = false;
        if (first + i < first || map_read_bit(coils, (uint16_t)(first + i), &value) != MODBUS_OK)
            return MODBUS_ILLEGAL_ADDRESS;
        if (value)
            data[1 + i / 8] |= (uint8_t)(1u << (i % 8));
    }
    data[0] = bytes;
    *size = (uint16_t)(1u + bytes);
    return MODBUS_OK;
}

static uint8_t put_registers(uint8_t *data, uint16_t *size, bool input, uint16_t first, uint16_t count)
{
    if (count < 1 || count > REGISTERS_READ_MAX)
        return MODBUS_ILLEGAL_VALUE;
    for (uint16_t i = 0; i < count; i++) {
        uint16_t value = 0;
        if ((uint16_t)(first + i) < first || map_read_register(input, (uint16_t)(first + i), &value) != MODBUS_OK)
            return MODBUS_ILLEGAL_ADDRESS;
        put_word(data + 1 + 2 * i, value);
    }
    data[0] = (uint8_t)(2 * count);
    *size = (uint16_t)(1u + 2u * count);
    return MODBUS_OK;
}

static uint8_t read_registers(uint8_t *data, uint16_t *size, bool input)
{
    if (*size != 4)
        return MODBUS_ILLEGAL_VALUE;
    return put_registers(data, size, input, word_at(data), word_at(data + 2));
}

static uint8_t write_coil(const uint8_t *data, uint16_t size)
{
    if (size != 4)
        return MODBUS_ILLEGAL_VALUE;
    uint16_t value = word_at(data + 2);
    if (value != COIL_ON && value != 0)
        return MODBUS_ILLEGAL_VALUE;
    uint8_t packed = value == COIL_ON;
    return map_write_coils(word_at(data), 1, &packed);
}

static uint8_t write_coils(const uint8_t *data, uint16_t *size)
{
    if (*size < 6)
        return MODBUS_ILLEGAL_VALUE;
    uint16_t count = word_at(data + 2);
    if (count < 1 || count > BITS_WRITE_MAX || data[4] != (count + 7u) / 8u || *size != 5u + data[4])
        return MODBUS_ILLEGAL_VALUE;
    *size = 4;
    return map_write_coils(word_at(data), count, data + 5);
}

static uint8_t write_registers(const uint8_t *data, uint16_t *size)
{
    if (*size < 7)
        return MODBUS_ILLEGAL_VALUE;
    uint16_t count = word_at(data + 2);
    if (count < 1 || count > REGISTERS_WRITE_MAX || data[4] != 2u * count || *size != 5u + data[4])
        return MODBUS_ILLEGAL_VALUE;
    *size = 4;
    return map_write_registers(word_at(data), count, data + 5);
}

static uint8_t read_write_registers(uint8_t *data, uint16_t *size)
{
    if (*size < 11)
        return MODBUS_ILLEGAL_VALUE;
    uint16_t read_first = word_at(data), read_count = word_at(data + 2), write_count = word_at(data + 6);
    if (write_count < 1 || write_count > REGISTERS_READ_WRITE_MAX || data[8] != 2u * write_count ||
        *size != 9u + data[8])
        return MODBUS_ILLEGAL_VALUE;
    /* Whether it can be read is asked first: a request that is refused has changed nothing. */
    uint16_t unused = 0;
    if (read_count < 1 || read_count > REGISTERS_READ_MAX)
        return MODBUS_ILLEGAL_VALUE;
    if (map_read_register(false, read_first, &unused) != MODBUS_OK ||
        (uint16_t)(read_first + read_count - 1) < read_first ||
        map_read_register(false, (uint16_t)(read_first + read_count - 1), &unused) != MODBUS_OK)
        return MODBUS_ILLEGAL_ADDRESS;
    uint8_t refused = map_write_registers(word_at(data + 4), write_count, data + 9);
    if (refused != MODBUS_OK)
        return refused;
    return put_registers(data, size, false, read_first, read_count);
}

static uint8_t carry_out(uint8_t function, uint8_t *data, uint16_t *size)
{
    switch (function) {
    case READ_COILS:
        return read_bits(data, size, true);
    case READ_DISCRETE_INPUTS:
        return read_bits(data, size, false);
    case READ_HOLDING_REGISTERS:
        return read_registers(data, size, false);
    case READ_INPUT_REGISTERS:
        return read_registers(data, size, true);
    case WRITE_COIL:
        return write_coil(data, *size);
    case WRITE_REGISTER:
        return *size == 4 ? map_write_registers(word_at(data), 1, data + 2) : MODBUS_ILLEGAL_VALUE;
    case DIAGNOSTICS: /* sub-function 0 alone: the reply is the request */
        return *size >= 2 && word_at(data) == 0 ? MODBUS_OK : MODBUS_ILLEGAL_FUNCTION;
    case WRITE_COILS:
        return write_coils(data, size);
    case WRITE_REGISTERS:
        return write_registers(data, size);
    case READ_WRITE_REGISTERS:
        return read_write_registers(data, size);
    default:
        return MODBUS_ILLEGAL_FUNCTION;
    }
}

static bool writes(uint8_t function)
{
    return function == WRITE_COIL || function == WRITE_REGISTER || function == WRITE_COILS ||
           function == WRITE_REGISTERS;
}

static bool intact(modbus_server *server)
{
    uint16_t length = server->length;
    if (!server->damaged && length >= FRAME_MIN) {
        uint16_t sent = (uint16_t)(server->frame[length - 2] | (uint16_t)(server->frame[length - 1] << 8));
        if (modbus_crc(server->frame, (uint16_t)(length - CRC_LENGTH)) == sent)
            return true;
    }
    server->check_sum_errors++;
    return false;
}

uint16_t modbus_poll(modbus_server *server, uint32_t now_us)
{
    if ((server->length == 0 && !server->damaged) || now_us - server->last_byte_us < server->silence_us)
        return 0;
    uint8_t *frame = server->frame;
    uint16_t size = (uint16_t)(server->length - FRAME_MIN);
    bool good = intact(server);
    server->length = 0;
    server->damaged = false;
    if (!good || (frame[0] != server->address && frame[0] != BROADCAST))
        return 0;
    server->frames++;
    if (frame[0] == BROADCAST) { /* carried out where it writes, and never answered */
        if (writes(frame[1]))
            (void)carry_out(frame[1], frame + 2, &size);
        return 0;
    }
    uint8_t exception = carry_out(frame[1], frame + 2, &size);
    if (exception != MODBUS_OK) {
        frame[1] |= EXCEPTION_FLAG;
        frame[2] = exception;
        size = 1;
    }
    uint16_t length = (uint16_t)(2u + size);
    uint16_t crc = modbus_crc(frame, length);
    frame[length] = (uint8_t)crc;
    frame[length + 1] = (uint8_t)(crc >> 8);
    return (uint16_t)(length + CRC_LENGTH);
}
