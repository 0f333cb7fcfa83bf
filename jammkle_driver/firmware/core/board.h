/* What the board does: outputs, watchdog, safe state and its latch, sensors and their calibration. */
#ifndef JAMMKLE_BOARD_H
#define JAMMKLE_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "modbus.h"
#include "registers.h"

/* A dip of the supply that lasts shorter is the inrush of a pump, not a brown-out. Assumed. */
#define SUPPLY_LOW_MS 5u

enum { SENSOR_COUNT = 4, ADC_COUNT = SENSOR_COUNT + 1, RAW_MAX = 16368 };

/* Start: read what is stored, everything off, RESET latched with its cause (bits RESET_CAUSE_...). */
void board_init(modbus_server *server, uint16_t reset_cause);

/* Look at the clocks and the supply; to be called at least once a millisecond. */
void board_poll(uint32_t now_ms);

/* Take one reading of a sensor, or (SENSOR_COUNT) of the supply's divider: sum of 16 conversions of 10 bits. */
void board_take_reading(uint8_t input, uint16_t raw);

/* What the pins shall be: solenoids in bits 0 to 2, duty in thousandths. */
uint8_t board_solenoids(void);
uint16_t board_pump_duty(void);

/* Memory that lasts over a reset; brought along by the hardware layer. `load` returns false where nothing is kept. */
bool hal_load(uint8_t *bytes, uint8_t length);
void hal_store(const uint8_t *bytes, uint8_t length);

#endif
