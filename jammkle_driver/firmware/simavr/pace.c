/* How long one cycle on the line takes, counted in clocks of the chip in simavr: a request that writes all outputs and
 * reads all sensors comes in, is carried out and answered, and the line is silent.
 *
 * Usage: pace IMAGE.elf MHZ; prints the bytes of each reply and the time of its cycle, us. Ten cycles, as the driver
 * makes them: nine read what every cycle needs, one what the board says of itself. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <avr_adc.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>

#include "modbus.h"
#include "registers.h"

enum { REFERENCE_MV = 5000, SENSOR_MV = 3000, INPUTS = 5, CYCLES = 10, START_MS = 50, LONGEST_MS = 30 };
enum { SILENCE_US = 1750, CHARACTER_NS = 86806, SHORT = INPUT_PUMP_DUTY_DRIVEN + 1, WHOLE = INPUT_CHECK_SUM_ERRORS + 1 };

static avr_t *avr;
static unsigned answered;
static avr_cycle_count_t last;

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    answered++;
    last = avr->cycle;
}

/* As of core/modbus.c, which the image has for itself. */
static uint16_t check_sum(const uint8_t *data, size_t length)
{
    uint16_t crc = 0xFFFFu;
    for (size_t i = 0; i < length * 8; i++) {
        if (i % 8 == 0)
            crc ^= data[i / 8];
        crc = (crc & 1u) ? (uint16_t)((crc >> 1) ^ 0xA001u) : (uint16_t)(crc >> 1);
    }
    return crc;
}

static void run_until(avr_cycle_count_t cycle)
{
    while (avr->cycle < cycle && avr->state != cpu_Crashed && avr->state != cpu_Done)
        avr_run(avr);
}

int main(int count, char **arguments)
{
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    unsigned mhz = count == 3 ? (unsigned)atoi(arguments[2]) : 0;
    if (mhz == 0 || elf_read_firmware(arguments[1], &firmware) != 0 || !(avr = avr_make_mcu_by_name("atmega328p"))) {
        fprintf(stderr, "usage: %s IMAGE.elf MHZ\n", arguments[0]);
        return 2;
    }
    avr_init(avr);
    firmware.frequency = mhz * 1000000u;
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = avr->aref = REFERENCE_MV;
    avr->log = LOG_ERROR;
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_POLL_SLEEP | AVR_UART_FLAG_STDIO);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, NULL);
    for (int i = 0; i < INPUTS; i++)
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + i), SENSOR_MV);
    run_until((avr_cycle_count_t)START_MS * 1000u * mhz);
    for (int cycle = 0; cycle < CYCLES; cycle++) {
        uint8_t request[17] = {1, 23, MIRROR_ADDRESS >> 8, MIRROR_ADDRESS & 0xFF, 0, cycle ? SHORT : WHOLE,
                               0, HOLDING_OUTPUTS, 0, 2, 4};
        uint16_t crc = check_sum(request, sizeof request - 2);
        request[sizeof request - 2] = (uint8_t)crc;
        request[sizeof request - 1] = (uint8_t)(crc >> 8);
        answered = 0;
        avr_cycle_count_t began = last = avr->cycle;
        for (size_t i = 0; i < sizeof request; i++) /* simavr brings them in at the pace of the line */
            avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), request[i]);
        run_until(began + (avr_cycle_count_t)LONGEST_MS * 1000u * mhz);
        /* What was handed to the transmitter last waits for one character, and is one. */
        printf("%u %lld\n", answered, (long long)((last - began) / mhz + 2 * CHARACTER_NS / 1000 + SILENCE_US));
    }
    return 0;
}
