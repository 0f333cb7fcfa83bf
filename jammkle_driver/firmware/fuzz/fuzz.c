/* Malformed and well-formed frames at random, straight into the core: no crash, no hang, no unsafe output.
 *
 * Usage: fuzz [FRAMES [SEED]]. Built with the compiler's address and undefined-behaviour sanitisers. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"

static uint64_t state;
static uint32_t silent_ms, low_ms;
static uint8_t memory[256];
static bool kept;

static uint32_t draw(uint32_t below) /* xorshift64* (Vigna 2016) */
{
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)((state * 2685821657736338717u) >> 33) % below;
}

bool hal_load(uint8_t *bytes, uint8_t length)
{
    if (kept)
        memcpy(bytes, memory, length);
    return kept;
}

void hal_store(const uint8_t *bytes, uint8_t length)
{
    memcpy(memory, bytes, length);
    kept = true;
}

static void fail(const char *what, long frame)
{
    fprintf(stderr, "fuzz: frame %ld: %s\n", frame, what);
    exit(1);
}

/* A frame that gets far: a known function, addresses and counts near the limits, its check sum right most of the time. */
static uint16_t make_frame(uint8_t *frame)
{
    static const uint8_t functions[] = {1, 2, 3, 4, 5, 6, 8, 15, 16, 23, 7, 43};
    uint16_t length;
    if (draw(8) == 0) {
        length = (uint16_t)draw(300);
        for (uint16_t i = 0; i < length; i++)
            frame[i] = (uint8_t)draw(256);
        return length;
    }
    frame[0] = (uint8_t)(draw(16) == 0 ? draw(256) : draw(8) == 0 ? 0 : 1);
    frame[1] = functions[draw(sizeof functions)];
    uint16_t size = (uint16_t)(draw(4) == 0 ? draw(252) : 4);
    bool sets = frame[1] == 15 || frame[1] == 16 || frame[1] == 23;
    for (uint16_t i = 0; i < 252; i++)
        frame[2 + i] = (uint8_t)(draw(3) == 0 ? draw(256) : draw(4));
    frame[2] = (uint8_t)(draw(6) == 0 ? draw(256) : draw(2)); /* addresses of this board are below 280 */
    frame[3] = (uint8_t)draw(30);
    bool near_right = draw(4) != 0;
    if (near_right && sets) {
        uint8_t count = (uint8_t)(1 + draw(draw(4) ? 3 : 30)), head = frame[1] == 23 ? 8 : 4;
        uint8_t bytes = (uint8_t)(frame[1] == 15 ? (count + 7) / 8 : 2 * count);
        if (frame[1] == 23) {
            frame[4] = 0;
            frame[5] = (uint8_t)(1 + draw(24));
            frame[6] = 0;
            frame[7] = (uint8_t)draw(draw(2) ? 2 : 26);
        }
        frame[head] = 0;
        frame[head + 1] = count;
        frame[head + 2] = bytes;
        size = (uint16_t)(head + 1 + bytes);
    } else if (near_right && frame[1] <= 4) {
        frame[4] = 0;
        frame[5] = (uint8_t)(1 + draw(20));
    } else if (near_right && frame[1] == 5) {
        frame[3] = (uint8_t)draw(4);
        frame[4] = (uint8_t)(draw(2) ? 0xFF : 0);
        frame[5] = 0;
    } else if (near_right && frame[1] == 6) {
        frame[3] = (uint8_t)draw(10);
        frame[4] = (uint8_t)draw(4);
    }
    length = (uint16_t)(2 + size);
    uint16_t crc = modbus_crc(frame, length);
    frame[length] = (uint8_t)crc;
    frame[length + 1] = (uint8_t)(crc >> 8);
    if (draw(8) == 0)
        frame[draw(length + 2u)] ^= (uint8_t)(1u << draw(8));
    return (uint16_t)(length + 2);
}

/* The linker has the core write through these: a write that was taken is the only sign of life there is. */
uint8_t __real_map_write_coils(uint16_t address, uint16_t count, const uint8_t *packed);
uint8_t __real_map_write_registers(uint16_t address, uint16_t count, const uint8_t *big_endian);

uint8_t __wrap_map_write_coils(uint16_t address, uint16_t count, const uint8_t *packed)
{
    uint8_t exception = __real_map_write_coils(address, count, packed);
    silent_ms = exception == MODBUS_OK ? 0 : silent_ms;
    return exception;
}

uint8_t __wrap_map_write_registers(uint16_t address, uint16_t count, const uint8_t *big_endian)
{
    uint8_t exception = __real_map_write_registers(address, count, big_endian);
    silent_ms = exception == MODBUS_OK ? 0 : silent_ms;
    return exception;
}

static uint16_t value_of(bool input, uint16_t address)
{
    uint16_t value = 0;
    map_read_register(input, address, &value);
    return value;
}

/* Let a millisecond pass. Both limits are held to the millisecond of the core's own clock, neither later nor sooner. */
static void pass(uint32_t now_ms, long frame)
{
    uint16_t before = value_of(true, INPUT_LATCHED);
    bool low = value_of(true, INPUT_SUPPLY) < value_of(false, HOLDING_SUPPLY_MINIMUM);
    silent_ms++;
    low_ms = low ? low_ms + 1 : 0;
    board_poll(now_ms);
    uint16_t latched = value_of(true, INPUT_LATCHED), came = latched & (uint16_t)~before;
    bool silent = silent_ms >= value_of(false, HOLDING_WATCHDOG_MS);
    if (silent && !latched)
        fail("nobody has written for watchdog_ms, and no safe state is taken", frame);
    if ((came & LATCHED_HOST_SILENT) && !silent)
        fail("the safe state is taken before watchdog_ms of silence", frame);
    if (low_ms >= SUPPLY_LOW_MS && !(latched & LATCHED_SUPPLY_LOW))
        fail("the supply was low for 5 ms, and no safe state is taken", frame);
    if ((came & LATCHED_SUPPLY_LOW) && low_ms < SUPPLY_LOW_MS)
        fail("the safe state is taken for a dip of the supply", frame);
    if (came && (board_pump_duty() || (board_solenoids() && value_of(false, HOLDING_SAFE_STATE) == 0)))
        fail("the safe state is taken, and something is still driven", frame);
}

int main(int count, char **arguments)
{
    long frames = count > 1 ? atol(arguments[1]) : 100000;
    state = count > 2 ? strtoull(arguments[2], NULL, 10) + 1 : 1;
    static modbus_server server;
    uint32_t now_us = 0xFFF00000u; /* the clock turns over soon */
    uint32_t now_ms = 0xFFFF0000u;
    long answered = 0, refused = 0, jammed = 0;
    bool latched_before = true;
    modbus_init(&server, 1, 115200);
    board_init(&server, RESET_CAUSE_POWER_ON);
    board_poll(now_ms);
    for (uint8_t i = 0; i < ADC_COUNT; i++)
        board_take_reading(i, RAW_MAX);
    for (long frame = 0; frame < frames; frame++) {
        uint8_t bytes[512];
        uint16_t length = make_frame(bytes);
        uint8_t solenoids_before = board_solenoids();
        for (uint16_t i = 0; i < length; i++)
            modbus_take(&server, bytes[i], draw(2000) != 0, now_us += 87);
        now_us += 2000;
        for (uint32_t left_ms = 1 + (draw(50) == 0 ? draw(300) : draw(3)); left_ms > 0; left_ms--)
            pass(++now_ms, frame);
        uint16_t reply = modbus_poll(&server, now_us);
        if (reply > MODBUS_FRAME_MAX || (reply && modbus_crc(server.frame, reply) != 0))
            fail("the reply is too long or its check sum is wrong", frame);
        uint16_t latched = value_of(true, INPUT_LATCHED), duty = board_pump_duty();
        if (board_solenoids() > 7 || duty > 1000)
            fail("an output out of its range", frame);
        if (latched && latched_before && ((board_solenoids() & (uint8_t)~solenoids_before) || duty))
            fail("jammed while the safe state was latched", frame);
        latched_before = latched != 0;
        answered += reply > 0;
        refused += reply == 5;
        jammed += !latched && (board_solenoids() || duty);
        /* Now and then somebody acknowledges, or the chip is reset, so that every state is met. */
        if (draw(20) == 0) {
            uint8_t word[2] = {(uint8_t)(latched >> 8), (uint8_t)latched};
            map_write_registers(HOLDING_ACKNOWLEDGE, 1, word);
            latched_before = false;
        }
        if (draw(500) == 0) {
            modbus_init(&server, 1, 115200);
            board_init(&server, (uint16_t)(1u << draw(4)));
            now_ms = draw(2) ? 0 : 0xFFFFFF00u; /* which turns over soon */
            silent_ms = low_ms = 0;
            board_poll(now_ms); /* as a chip does, before the first conversion is done */
            latched_before = false;
            for (uint8_t i = 0; i < ADC_COUNT; i++)
                board_take_reading(i, (uint16_t)draw(2 * RAW_MAX));
        }
    }
    printf("%ld frames: %ld answered, %ld of them refused; %ld times something was driven\n", frames, answered, refused,
           jammed);
    return jammed > 0 && answered > refused && refused > 0 ? 0 : 1;
}
