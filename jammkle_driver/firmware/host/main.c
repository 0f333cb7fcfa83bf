/* The board as a process: the same core, behind a pseudo terminal, its pins on a socket (see wires.h). */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "board.h"
#include "wires.h"

enum { ADDRESS = 1, STEP_US = 1000, REFERENCE_UV = 5000000, RECEIVE_MAX = 512, CHARACTER_BITS = 10 };

static const char *store_path;
static volatile sig_atomic_t stopped;

static void stop(int signal_number)
{
    (void)signal_number;
    stopped = 1;
}

bool hal_load(uint8_t *bytes, uint8_t length)
{
    FILE *file = store_path ? fopen(store_path, "rb") : NULL;
    if (!file)
        return false;
    size_t got = fread(bytes, 1, length, file);
    fclose(file);
    return got == length;
}

void hal_store(const uint8_t *bytes, uint8_t length)
{
    FILE *file = store_path ? fopen(store_path, "wb") : NULL;
    if (!file)
        return;
    fwrite(bytes, 1, length, file);
    fclose(file);
}

static void read_pins(const wires *ends)
{
    for (uint8_t i = 0; ends->adc_known && i < ADC_COUNT; i++) {
        int64_t raw = ((int64_t)ends->adc_uv[i] * RAW_MAX + REFERENCE_UV / 2) / REFERENCE_UV;
        board_take_reading(i, raw < 0 ? 0 : raw > RAW_MAX ? RAW_MAX : (uint16_t)raw);
    }
}

int main(int count, char **arguments)
{
    const char *link = NULL, *pins = NULL;
    long baud = 115200;
    int option;
    while ((option = getopt(count, arguments, "l:p:b:s:")) != -1) {
        if (option == 'l')
            link = optarg;
        else if (option == 'p')
            pins = optarg;
        else if (option == 'b')
            baud = atol(optarg);
        else if (option == 's')
            store_path = optarg;
    }
    if (!link || !pins || baud < 1200 || optind != count) {
        fprintf(stderr, "usage: %s -l DEVICE -p SOCKET [-b BAUD] [-s FILE]\n"
                        "  DEVICE: where the serial device appears; SOCKET: of the plant behind the pins;\n"
                        "  FILE: where what is stored is kept\n", arguments[0]);
        return 2;
    }
    signal(SIGTERM, stop);
    signal(SIGINT, stop);
    static modbus_server server;
    static wires ends;
    wires_open(&ends, link, pins);
    modbus_init(&server, ADDRESS, (uint32_t)baud);
    board_init(&server, RESET_CAUSE_POWER_ON);
    const int64_t origin_us = wires_now_us();
    int64_t start_us = origin_us, looked_us = origin_us, held_until_us = 0, reply_us = 0, arrived_us = 0;
    uint8_t received[RECEIVE_MAX];
    size_t arriving = 0;
    uint16_t reply = 0;
    const int64_t byte_us = CHARACTER_BITS * 1000000 / baud;
    while (!stopped) {
        /* The next moment at which something is due: bytes on their way, the end of a frame, a reply. */
        int64_t now_us = wires_now_us(), wait_us = STEP_US;
        if (arriving > 0 && arrived_us - now_us < wait_us)
            wait_us = arrived_us - now_us;
        if (server.length > 0 && !reply) {
            int64_t left_us = (int64_t)server.silence_us - (uint32_t)((uint32_t)now_us - server.last_byte_us);
            wait_us = left_us < wait_us ? left_us : wait_us;
        }
        if (reply && reply_us - now_us < wait_us)
            wait_us = reply_us - now_us;
        if (!wires_wait(&ends, wait_us > 0 ? wait_us : 0))
            break;
        now_us = wires_now_us();
        if (ends.reset_asked) {
            ends.reset_asked = false;
            held_until_us = now_us + (int64_t)ends.reset_ms * 1000;
            wires_tell_event(&ends, "reset", now_us - origin_us);
            /* Pins of a chip in reset float, and pull-downs switch everything off. */
            wires_tell_pins(&ends, 0, 0, now_us - origin_us);
            arriving = reply = 0;
        }
        if (held_until_us) {
            uint8_t dropped[RECEIVE_MAX];
            wires_receive(&ends, dropped, sizeof dropped);
            if (now_us < held_until_us)
                continue;
            held_until_us = 0;
            start_us = looked_us = now_us;
            modbus_init(&server, ADDRESS, (uint32_t)baud);
            board_init(&server, (uint16_t)ends.reset_cause);
        }
        /* A chip looks at its clock all the time: what this machine was too late for is made up for step by step. */
        while (now_us - looked_us >= STEP_US) {
            looked_us += STEP_US;
            board_poll((uint32_t)((looked_us - start_us) / 1000));
            wires_tell_pins(&ends, board_solenoids(), board_pump_duty(), looked_us - origin_us);
        }
        read_pins(&ends);
        if (ends.mark_asked)
            wires_tell_event(&ends, "mark", now_us - origin_us);
        ends.mark_asked = false;
        /* A pseudo terminal has no baud rate: bytes count as here once a line of this one would have brought them. */
        if (arriving == 0 && (arriving = wires_receive(&ends, received, sizeof received)) > 0)
            arrived_us = now_us + (int64_t)arriving * byte_us;
        if (arriving > 0 && now_us >= arrived_us) {
            for (size_t i = 0; i < arriving && !reply; i++)
                modbus_take(&server, received[i], true, (uint32_t)now_us);
            arriving = 0;
        }
        if (!reply && (reply = modbus_poll(&server, (uint32_t)now_us)) > 0)
            reply_us = now_us + reply * byte_us;
        wires_tell_pins(&ends, board_solenoids(), board_pump_duty(), now_us - origin_us);
        if (reply && now_us >= reply_us) {
            wires_send(&ends, server.frame, reply);
            reply = 0;
        }
    }
    wires_close(&ends);
    return 0;
}
