/* The AVR image in simavr, with the same two ends as the board for the host: see host/wires.h. */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <avr_adc.h>
#include <avr_eeprom.h>
#include <avr_ioport.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>

#include "wires.h"

enum { CLOCK_MHZ = 8, SLICE_US = 250, LARGEST_LAG_US = 50000, STORE_BYTES = 128, QUEUE = 1024 };

/* Addresses in the data space of the ATmega328P (data sheet DS40002061, chapter 30). */
enum { ADDRESS_DDRB = 0x24, ADDRESS_PORTB = 0x25, ADDRESS_DDRD = 0x2A, ADDRESS_PORTD = 0x2B };
enum { ADDRESS_MCUSR = 0x54, ADDRESS_TCCR1A = 0x80, ADDRESS_ICR1 = 0x86, ADDRESS_OCR1A = 0x88, COM1A1 = 0x80 };
enum { SOLENOID_SHIFT = 2, SOLENOID_BITS = 7, PUMP_BIT = 2, JUMP_TO_ITSELF = 0xCFFF };
enum { LOOK_INSTRUCTIONS = 8, MILLIVOLTS = 1000, REFERENCE_MV = 5000 };

static volatile sig_atomic_t stopped;
static avr_t *avr;
static uint8_t going_out[QUEUE], coming_in[QUEUE];
static size_t out_count, in_count, in_next;
static bool may_send = true;
static int64_t cycles; /* of the chip since its start, through resets */

static void stop(int signal_number)
{
    (void)signal_number;
    stopped = 1;
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)unused;
    if (out_count < QUEUE)
        going_out[out_count++] = (uint8_t)value;
}

static void on_room(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    may_send = true;
}

static void on_full(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    may_send = false;
}

static uint16_t word_at(int address)
{
    return (uint16_t)(avr->data[address] | avr->data[address + 1] << 8);
}

/* What the port registers put onto the pins. A pin whose direction is in is pulled down by the circuit. */
static void tell_pins(wires *ends, int64_t board_us)
{
    uint8_t solenoids = (uint8_t)((avr->data[ADDRESS_PORTD] & avr->data[ADDRESS_DDRD]) >> SOLENOID_SHIFT & SOLENOID_BITS);
    int duty = 0, top = word_at(ADDRESS_ICR1);
    if (avr->data[ADDRESS_DDRB] & PUMP_BIT) {
        if ((avr->data[ADDRESS_TCCR1A] & COM1A1) && top > 0)
            duty = (word_at(ADDRESS_OCR1A) * 1000 + top / 2) / top;
        else if (avr->data[ADDRESS_PORTB] & PUMP_BIT)
            duty = 1000;
    }
    wires_tell_pins(ends, solenoids, (uint16_t)duty, board_us);
}

/* Reset the chip, and only it: what its registers then hold, and the image makes of it, is looked at as ever. */
static void reset(wires *ends, int64_t board_us)
{
    avr_reset(avr);
    wires_tell_event(ends, "reset", board_us);
    tell_pins(ends, board_us);
}

/* Let the processor spin without interrupts, as a program that has lost its way: at the first jump to itself. */
static void hang(void)
{
    for (uint32_t at = 0; at + 1 < avr->codeend; at += 2)
        if ((avr->flash[at] | avr->flash[at + 1] << 8) == JUMP_TO_ITSELF) {
            avr->sreg[S_I] = 0;
            avr->pc = at;
            return;
        }
}

static void keep(const char *path, bool save)
{
    uint8_t bytes[STORE_BYTES];
    avr_eeprom_desc_t part = {.ee = bytes, .offset = 0, .size = STORE_BYTES};
    FILE *file = path ? fopen(path, save ? "wb" : "rb") : NULL;
    if (!file)
        return;
    if (save) {
        avr_ioctl(avr, AVR_IOCTL_EEPROM_GET, &part);
        fwrite(bytes, 1, STORE_BYTES, file);
    } else if (fread(bytes, 1, STORE_BYTES, file) == STORE_BYTES) {
        avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &part);
    }
    fclose(file);
}

static bool start(const char *image)
{
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    if (elf_read_firmware(image, &firmware) != 0)
        return false;
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr)
        return false;
    avr_init(avr);
    firmware.frequency = CLOCK_MHZ * 1000000;
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = avr->aref = REFERENCE_MV;
    avr->log = LOG_ERROR;
    /* A firmware that asks again and again whether a byte is there is put to sleep otherwise. */
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_POLL_SLEEP | AVR_UART_FLAG_STDIO);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_room, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_full, NULL);
    return true;
}

static void feed(wires *ends)
{
    for (int i = 0; ends->adc_known && i < WIRES_ADC_COUNT; i++)
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + i),
                      (uint32_t)(ends->adc_uv[i] / MILLIVOLTS));
    if (in_next == in_count)
        in_next = 0, in_count = wires_receive(ends, coming_in, QUEUE);
    avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    while (may_send && in_next < in_count)
        avr_raise_irq(input, coming_in[in_next++]);
}

int main(int count, char **arguments)
{
    const char *link = NULL, *pins = NULL, *store = NULL, *image = NULL;
    int option;
    while ((option = getopt(count, arguments, "i:l:p:b:s:")) != -1) {
        if (option == 'i')
            image = optarg;
        else if (option == 'l')
            link = optarg;
        else if (option == 'p')
            pins = optarg;
        else if (option == 's')
            store = optarg;
    }
    if (!image || !link || !pins || !start(image)) {
        fprintf(stderr, "usage: %s -i IMAGE.elf -l DEVICE -p SOCKET [-s FILE]\n", arguments[0]);
        return 2;
    }
    signal(SIGTERM, stop);
    signal(SIGINT, stop);
    static wires ends;
    wires_open(&ends, link, pins);
    keep(store, false);
    /* The chip's time is that of its cycles. Where this machine does not keep up, it goes slower, and skips nothing. */
    int64_t origin_us = wires_now_us(), held_until_us = 0;
    avr->data[ADDRESS_MCUSR] = 1; /* power-on */
    while (!stopped && avr->state != cpu_Crashed && avr->state != cpu_Done) {
        if (!wires_wait(&ends, SLICE_US))
            break;
        int64_t now_us = wires_now_us();
        if (ends.reset_asked) {
            ends.reset_asked = false;
            held_until_us = now_us + (int64_t)ends.reset_ms * 1000;
            reset(&ends, cycles / CLOCK_MHZ);
        }
        if (held_until_us) {
            uint8_t dropped[QUEUE];
            wires_receive(&ends, dropped, QUEUE);
            if (now_us < held_until_us)
                continue;
            held_until_us = 0;
            avr->data[ADDRESS_MCUSR] = (uint8_t)ends.reset_cause;
            in_next = in_count = out_count = 0;
            may_send = true;
            cycles += (int64_t)ends.reset_ms * 1000 * CLOCK_MHZ;
            origin_us = now_us - cycles / CLOCK_MHZ;
        }
        if (!ends.adc_known) { /* a board without its sensors' voltages would see its supply fail */
            origin_us = now_us - cycles / CLOCK_MHZ;
            continue;
        }
        if (ends.hang_asked)
            hang();
        if (ends.mark_asked || ends.hang_asked)
            wires_tell_event(&ends, "mark", cycles / CLOCK_MHZ);
        ends.mark_asked = ends.hang_asked = false;
        feed(&ends);
        if (now_us - origin_us - cycles / CLOCK_MHZ > LARGEST_LAG_US)
            origin_us = now_us - cycles / CLOCK_MHZ - LARGEST_LAG_US;
        int64_t due = (now_us - origin_us) * CLOCK_MHZ;
        while (cycles < due && avr->state != cpu_Crashed && avr->state != cpu_Done) {
            bool has_reset = false; /* by its own watchdog; simavr's count may then begin anew */
            for (int i = 0; i < LOOK_INSTRUCTIONS && !has_reset; i++) {
                avr_cycle_count_t before = avr->cycle;
                avr_run(avr);
                cycles += (int64_t)(avr->cycle >= before ? avr->cycle - before : avr->cycle);
                has_reset = avr->pc == avr->reset_pc;
            }
            if (has_reset)
                wires_tell_event(&ends, "reset", cycles / CLOCK_MHZ);
            tell_pins(&ends, cycles / CLOCK_MHZ);
        }
        if (out_count > 0)
            wires_send(&ends, going_out, out_count);
        out_count = 0;
    }
    keep(store, true);
    wires_close(&ends);
    return 0;
}
