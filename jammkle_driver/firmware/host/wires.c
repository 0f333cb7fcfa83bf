#define _GNU_SOURCE
#include "wires.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static void give_up(const char *what)
{
    fprintf(stderr, "board: %s: %s\n", what, strerror(errno));
    exit(2);
}

int64_t wires_now_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

static void plug(wires *ends)
{
    if (ends->master >= 0)
        return;
    ends->master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (ends->master < 0 || grantpt(ends->master) != 0 || unlockpt(ends->master) != 0)
        give_up("no pseudo terminal");
    const char *name = ptsname(ends->master);
    /* Kept open, so that the master does not see an end whenever the host closes its own. */
    ends->slave = open(name, O_RDWR | O_NOCTTY);
    struct termios settings;
    if (ends->slave < 0 || tcgetattr(ends->slave, &settings) != 0)
        give_up(name);
    cfmakeraw(&settings);
    tcsetattr(ends->slave, TCSANOW, &settings);
    unlink(ends->link);
    if (symlink(name, ends->link) != 0)
        give_up(ends->link);
}

static void unplug(wires *ends)
{
    if (ends->master < 0)
        return;
    unlink(ends->link);
    close(ends->slave);
    close(ends->master);
    ends->master = ends->slave = -1;
}

void wires_open(wires *ends, const char *link, const char *socket_path)
{
    memset(ends, 0, sizeof *ends);
    ends->link = link;
    ends->master = ends->slave = -1;
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(socket_path) >= sizeof address.sun_path) {
        errno = ENAMETOOLONG;
        give_up(socket_path);
    }
    strcpy(address.sun_path, socket_path);
    ends->pins = socket(AF_UNIX, SOCK_STREAM, 0);
    if (ends->pins < 0 || connect(ends->pins, (struct sockaddr *)&address, sizeof address) != 0)
        give_up(socket_path);
    fcntl(ends->pins, F_SETFL, O_NONBLOCK);
    plug(ends);
}

void wires_close(wires *ends)
{
    unplug(ends);
    close(ends->pins);
}

static void take_line(wires *ends, const char *line)
{
    int32_t uv[WIRES_ADC_COUNT];
    int cause, ms;
    long count;
    if (sscanf(line, "adc %d %d %d %d %d", &uv[0], &uv[1], &uv[2], &uv[3], &uv[4]) == WIRES_ADC_COUNT) {
        memcpy(ends->adc_uv, uv, sizeof uv);
        ends->adc_known = true;
    } else if (sscanf(line, "reset %d %d", &cause, &ms) == 2) {
        ends->reset_asked = true;
        ends->reset_cause = cause;
        ends->reset_ms = ms;
    } else if (sscanf(line, "noise_in %ld", &count) == 1) {
        ends->noise_in = count;
    } else if (sscanf(line, "noise_out %ld", &count) == 1) {
        ends->noise_out = count;
    } else if (strcmp(line, "mark") == 0) {
        ends->mark_asked = true;
    } else if (strcmp(line, "hang") == 0) {
        ends->hang_asked = true;
    } else if (strcmp(line, "unplug") == 0) {
        unplug(ends);
    } else if (strcmp(line, "plug") == 0) {
        plug(ends);
    } else {
        fprintf(stderr, "board: the plant says '%s', which means nothing\n", line);
    }
}

static bool take_pins(wires *ends)
{
    for (;;) {
        ssize_t got = read(ends->pins, ends->pending + ends->pending_length,
                           sizeof ends->pending - 1 - ends->pending_length);
        if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR))
            return false;
        if (got < 0)
            return true;
        ends->pending_length += (size_t)got;
        ends->pending[ends->pending_length] = '\0';
        char *line = ends->pending, *end;
        while ((end = strchr(line, '\n')) != NULL) {
            *end = '\0';
            take_line(ends, line);
            line = end + 1;
        }
        ends->pending_length = strlen(line);
        memmove(ends->pending, line, ends->pending_length);
        if (ends->pending_length == sizeof ends->pending - 1)
            ends->pending_length = 0; /* a line that is too long for any message */
    }
}

bool wires_wait(wires *ends, int64_t timeout_us)
{
    struct pollfd both[2] = {{.fd = ends->pins, .events = POLLIN}, {.fd = ends->master, .events = POLLIN}};
    struct timespec timeout = {.tv_sec = timeout_us / 1000000, .tv_nsec = timeout_us % 1000000 * 1000};
    if (ppoll(both, 2, &timeout, NULL) < 0 && errno != EINTR)
        give_up("poll");
    return both[0].revents == 0 || take_pins(ends);
}

static void disturb(uint8_t *bytes, size_t length, long *noise)
{
    for (size_t i = 0; i < length && *noise > 0; i++, --*noise)
        bytes[i] ^= (uint8_t)(1u << (*noise % 8));
}

size_t wires_receive(wires *ends, uint8_t *bytes, size_t room)
{
    if (ends->master < 0)
        return 0;
    ssize_t got = read(ends->master, bytes, room);
    if (got <= 0)
        return 0;
    disturb(bytes, (size_t)got, &ends->noise_in);
    return (size_t)got;
}

void wires_send(wires *ends, const uint8_t *bytes, size_t length)
{
    uint8_t copy[512];
    if (ends->master < 0 || length > sizeof copy)
        return;
    memcpy(copy, bytes, length);
    disturb(copy, length, &ends->noise_out);
    /* A terminal that nobody reads is full at some time; what does not fit is lost, as on a real line. */
    if (write(ends->master, copy, length) < 0 && errno != EAGAIN)
        fprintf(stderr, "board: serial line: %s\n", strerror(errno));
}

static void tell(wires *ends, const char *line, int length)
{
    if (send(ends->pins, line, (size_t)length, MSG_NOSIGNAL) != length)
        fprintf(stderr, "board: the plant does not listen\n");
}

void wires_tell_pins(wires *ends, uint8_t solenoids, uint16_t duty_permille, int64_t board_us)
{
    char line[80];
    if (ends->pins_told && solenoids == ends->solenoids && duty_permille == ends->duty_permille)
        return;
    ends->pins_told = true;
    ends->solenoids = solenoids;
    ends->duty_permille = duty_permille;
    tell(ends, line, snprintf(line, sizeof line, "out %u %u %lld %lld\n", solenoids, duty_permille,
                              (long long)wires_now_us(), (long long)board_us));
}

void wires_tell_event(wires *ends, const char *event, int64_t board_us)
{
    char line[40];
    tell(ends, line, snprintf(line, sizeof line, "%s %lld\n", event, (long long)board_us));
}
