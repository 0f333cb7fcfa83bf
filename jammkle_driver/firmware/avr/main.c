/* The board on an ATmega328P, as on an Arduino Uno or Nano. Register and bit names are those of the data sheet
 * (Microchip DS40002061).
 *
 * Pins: D2, D3, D4 solenoids; D9 pump (20 kHz PWM); A0 to A2 channels, A3 manifold, A4 divider of the supply. */
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "board.h"

#ifndef BOARD_ADDRESS
#define BOARD_ADDRESS 1u
#endif

enum { SOLENOID_SHIFT = PORTD2, CONVERSIONS = 16, RING = 64 };

#define SOLENOID_MASK (7u << SOLENOID_SHIFT)
#define PWM_TOP (F_CPU / 20000u - 1u) /* 20 kHz: nobody hears it */
#define TICK_PRESCALER 64u
#define TICK_US (TICK_PRESCALER / (F_CPU / 1000000u))
#define EEPROM_ADDRESS ((uint8_t *)0)

static volatile uint8_t ring[RING];
static volatile uint8_t ring_damaged[RING / 8];
static volatile uint8_t ring_in;
static volatile uint32_t overflows;
static uint8_t ring_out;

/* What the bootloader leaves of the reset cause: optiboot clears MCUSR and hands it over in r2. */
static uint8_t reset_flags __attribute__((section(".noinit")));
void keep_reset_flags(void) __attribute__((naked, used, section(".init3")));
void keep_reset_flags(void)
{
    uint8_t handed_over;
    __asm__ volatile("mov %0, r2" : "=r"(handed_over));
    reset_flags = MCUSR ? MCUSR : handed_over;
    MCUSR = 0;
    wdt_disable(); /* after a reset by the watchdog it runs on with its shortest time */
}

bool hal_load(uint8_t *bytes, uint8_t length)
{
    eeprom_read_block(bytes, EEPROM_ADDRESS, length);
    return true;
}

/* Up to 3.4 ms a byte; the core allows it only while nothing is driven. */
void hal_store(const uint8_t *bytes, uint8_t length)
{
    for (uint8_t i = 0; i < length; i++) {
        eeprom_update_byte(EEPROM_ADDRESS + i, bytes[i]);
        wdt_reset();
    }
}

ISR(TIMER0_OVF_vect)
{
    overflows++;
}

ISR(USART_RX_vect)
{
    bool damaged = (UCSR0A & ((1u << FE0) | (1u << DOR0))) != 0;
    uint8_t place = ring_in % RING, bit = (uint8_t)(1u << (place % 8));
    ring[place] = UDR0;
    if (damaged)
        ring_damaged[place / 8] |= bit;
    else
        ring_damaged[place / 8] &= (uint8_t)~bit;
    ring_in++;
}

static uint32_t now_ticks(void)
{
    uint32_t high;
    uint8_t low;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        high = overflows;
        low = TCNT0;
        if ((TIFR0 & (1u << TOV0)) && low < 128u)
            high++;
    }
    return high << 8 | low;
}

static void set_up(void)
{
    DDRD |= SOLENOID_MASK;
    DDRB |= 1u << DDB1;
    /* time: timer 0, one tick per 64 clocks */
    TCCR0B = (1u << CS01) | (1u << CS00);
    TIMSK0 = 1u << TOIE0;
    /* pump: timer 1, fast PWM up to ICR1; the pin is only handed to the timer while there is a duty */
    ICR1 = PWM_TOP;
    TCCR1A = 1u << WGM11;
    TCCR1B = (1u << WGM13) | (1u << WGM12) | (1u << CS10);
    /* line: 8 data bits, no parity, 1 stop bit */
    UCSR0A = 1u << U2X0; /* first: simavr takes the rate from what stands here when the divisor is written */
    UBRR0 = (uint16_t)((F_CPU + BAUD_RATE * 4u) / (BAUD_RATE * 8u) - 1u);
    UCSR0C = (1u << UCSZ01) | (1u << UCSZ00);
    UCSR0B = (1u << RXEN0) | (1u << TXEN0) | (1u << RXCIE0);
    /* converter: reference is the supply of the sensors, at most 250 kHz */
    ADMUX = 1u << REFS0;
    ADCSRA = (1u << ADEN) | (1u << ADPS2) | (F_CPU > 8000000u ? 1u << ADPS1 : 1u << ADPS0);
    wdt_enable(WDTO_120MS);
    sei();
}

static void drive(uint8_t solenoids, uint16_t duty_permille)
{
    PORTD = (uint8_t)((PORTD & ~SOLENOID_MASK) | (unsigned)solenoids << SOLENOID_SHIFT);
    if (duty_permille == 0) { /* a timer at 0 still gives a spike in each period */
        TCCR1A &= (uint8_t)~(1u << COM1A1);
        PORTB &= (uint8_t)~(1u << PORTB1);
    } else {
        OCR1A = (uint16_t)((uint32_t)duty_permille * PWM_TOP / 1000u);
        TCCR1A |= 1u << COM1A1;
    }
}

/* One conversion after the other, round about; each call looks once and never waits. */
static void convert(void)
{
    static uint8_t input, count;
    static uint16_t sum;
    static bool started;
    if (started) {
        if (ADCSRA & (1u << ADSC))
            return;
        sum = (uint16_t)(sum + ADC);
        if (++count == CONVERSIONS) {
            board_take_reading(input, sum);
            input = (uint8_t)((input + 1u) % ADC_COUNT);
            sum = count = 0;
            ADMUX = (uint8_t)((1u << REFS0) | input);
        }
    }
    ADCSRA |= 1u << ADSC;
    started = true;
}

int main(void)
{
    static modbus_server server;
    uint32_t part_us = 0, now_us = 0, last_ticks = 0, ms = 0;
    uint16_t reply = 0, sent = 0;
    set_up();
    modbus_init(&server, BOARD_ADDRESS, BAUD_RATE);
    board_init(&server, reset_flags & 0x0Fu);
    for (;;) {
        wdt_reset();
        /* Both clocks go on by differences, so that they turn over together with theirs. */
        uint32_t ticks = now_ticks();
        uint32_t passed_us = (ticks - last_ticks) * TICK_US;
        last_ticks = ticks;
        now_us += passed_us;
        for (part_us += passed_us; part_us >= 1000u; part_us -= 1000u)
            ms++;
        while (ring_out != ring_in) {
            uint8_t place = ring_out % RING;
            bool damaged = (ring_damaged[place / 8] & (1u << (place % 8))) != 0;
            if (!reply) /* a byte that comes while a reply goes out belongs to nothing */
                modbus_take(&server, ring[place], !damaged, now_us);
            ring_out++;
        }
        convert();
        board_poll(ms);
        if (!reply) {
            reply = modbus_poll(&server, now_us);
            sent = 0;
        }
        drive(board_solenoids(), board_pump_duty());
        if (reply && (UCSR0A & (1u << UDRE0))) {
            UDR0 = server.frame[sent++];
            if (sent == reply)
                reply = 0;
        }
    }
}
