/* The two ends of a board that runs as a process: its serial line, a pseudo terminal, and its pins, a Unix socket.
 *
 * On the socket each line is one message. From the board: `out SOLENOIDS DUTY US BOARD_US`, bits, thousandths, the
 * machine's monotonic clock and the board's own, whenever a pin has changed; `reset BOARD_US`, when the chip was reset;
 * `mark BOARD_US`, the answer to `mark`. To the board: `adc UV UV UV UV UV`, voltage at the five analogue pins, uV;
 * `mark`, say what the board's clock shows; `reset CAUSE MS`, hold it in reset for so long, then start with these bits
 * of reset_cause; `hang`, let the chip do nothing any more (in simavr alone); `unplug` and `plug`, take the serial
 * device away and bring it back; `noise_in N` and `noise_out N`, turn over one bit in each of the next N bytes that
 * come in or go out.
 *
 * The board's own clock counts from its start, through resets. It is simulated: what is due on it happens at its moment,
 * however late the machine runs the process. */
#ifndef JAMMKLE_WIRES_H
#define JAMMKLE_WIRES_H

#include <stdbool.h>
#include <stdint.h>
#include <stddef.h>

enum { WIRES_ADC_COUNT = 5 };

typedef struct {
    const char *link; /* where the device is linked to */
    int master;       /* -1: unplugged */
    int slave;
    int pins;
    char pending[512];
    size_t pending_length;
    long noise_in;
    long noise_out;
    int32_t adc_uv[WIRES_ADC_COUNT];
    bool adc_known;
    bool mark_asked;
    bool hang_asked;
    bool reset_asked;
    int reset_cause;
    int32_t reset_ms;
    bool pins_told;
    uint8_t solenoids;
    uint16_t duty_permille;
} wires;

/* End the process with a message if the socket or the terminal cannot be had. */
void wires_open(wires *ends, const char *link, const char *socket_path);
void wires_close(wires *ends);

/* Wait at most `timeout_us` for something to happen, and take what the pins' socket brought. False: the plant is gone. */
bool wires_wait(wires *ends, int64_t timeout_us);

/* What came in on the serial line, noise applied; 0 if nothing. */
size_t wires_receive(wires *ends, uint8_t *bytes, size_t room);
void wires_send(wires *ends, const uint8_t *bytes, size_t length);

/* Say what the pins do from now on, `board_us` on the board's own clock; nothing where that was said last. */
void wires_tell_pins(wires *ends, uint8_t solenoids, uint16_t duty_permille, int64_t board_us);

/* Say that something has happened: `reset` or `mark`. */
void wires_tell_event(wires *ends, const char *event, int64_t board_us);

int64_t wires_now_us(void);

#endif
