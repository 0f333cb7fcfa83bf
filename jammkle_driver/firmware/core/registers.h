/* Written from config/registers.yaml by `make readme`: edit that file. */
#ifndef JAMMKLE_REGISTERS_H
#define JAMMKLE_REGISTERS_H

#include <stdbool.h>
#include <stdint.h>

#define FIRMWARE_VERSION 0x0100u
#define REGISTER_VERSION 1u
#define MIRROR_ADDRESS 256u

enum {
    COIL_SOLENOID_1,
    COIL_SOLENOID_2,
    COIL_SOLENOID_3,
    COIL_COUNT
};

enum {
    DISCRETE_SOLENOID_1_DRIVEN,
    DISCRETE_SOLENOID_2_DRIVEN,
    DISCRETE_SOLENOID_3_DRIVEN,
    DISCRETE_PUMP_DRIVEN,
    DISCRETE_SAFE_STATE_LATCHED,
    DISCRETE_COUNT
};

enum {
    INPUT_PRESSURE_1,
    INPUT_PRESSURE_2,
    INPUT_PRESSURE_3,
    INPUT_PRESSURE_4,
    INPUT_LATCHED,
    INPUT_FAULTS,
    INPUT_OUTPUTS_DRIVEN,
    INPUT_PUMP_DUTY_DRIVEN,
    INPUT_SUPPLY,
    INPUT_RESET_CAUSE,
    INPUT_UPTIME_HIGH,
    INPUT_UPTIME_LOW,
    INPUT_CHECK_SUM_ERRORS,
    INPUT_RAW_1,
    INPUT_RAW_2,
    INPUT_RAW_3,
    INPUT_RAW_4,
    INPUT_RAW_SUPPLY,
    INPUT_FRAMES,
    INPUT_FIRMWARE_VERSION,
    INPUT_REGISTER_VERSION,
    INPUT_COUNT
};

enum {
    HOLDING_OUTPUTS,
    HOLDING_PUMP_DUTY,
    HOLDING_WATCHDOG_MS,
    HOLDING_ACKNOWLEDGE,
    HOLDING_SAFE_STATE,
    HOLDING_STORE,
    HOLDING_SUPPLY_MINIMUM,
    HOLDING_SUPPLY_FULL_SCALE,
    HOLDING_SENSOR_1_RAW_LOW,
    HOLDING_SENSOR_1_PRESSURE_LOW,
    HOLDING_SENSOR_1_RAW_HIGH,
    HOLDING_SENSOR_1_PRESSURE_HIGH,
    HOLDING_SENSOR_2_RAW_LOW,
    HOLDING_SENSOR_2_PRESSURE_LOW,
    HOLDING_SENSOR_2_RAW_HIGH,
    HOLDING_SENSOR_2_PRESSURE_HIGH,
    HOLDING_SENSOR_3_RAW_LOW,
    HOLDING_SENSOR_3_PRESSURE_LOW,
    HOLDING_SENSOR_3_RAW_HIGH,
    HOLDING_SENSOR_3_PRESSURE_HIGH,
    HOLDING_SENSOR_4_RAW_LOW,
    HOLDING_SENSOR_4_PRESSURE_LOW,
    HOLDING_SENSOR_4_RAW_HIGH,
    HOLDING_SENSOR_4_PRESSURE_HIGH,
    HOLDING_COUNT
};

enum {
    LATCHED_HOST_SILENT = 1,
    LATCHED_SUPPLY_LOW = 2,
    LATCHED_RESET = 4,
};

enum {
    FAULTS_SUPPLY_LOW = 1,
    FAULTS_CALIBRATION_LOST = 2,
};

enum {
    RESET_CAUSE_POWER_ON = 1,
    RESET_CAUSE_EXTERNAL = 2,
    RESET_CAUSE_BROWN_OUT = 4,
    RESET_CAUSE_WATCHDOG = 8,
};

typedef struct {
    uint16_t minimum;
    uint16_t maximum;
    uint16_t default_value;
} holding_range;

static const holding_range HOLDING_RANGES[HOLDING_COUNT] = {
    {0u, 7u, 0u}, /* outputs */
    {0u, 1000u, 0u}, /* pump_duty */
    {50u, 5000u, 200u}, /* watchdog_ms */
    {0u, 65535u, 0u}, /* acknowledge */
    {0u, 1u, 0u}, /* safe_state */
    {0u, 1u, 0u}, /* store */
    {0u, 60000u, 10000u}, /* supply_minimum */
    {1u, 60000u, 20000u}, /* supply_full_scale */
    {0u, 16368u, 655u}, /* sensor_1_raw_low */
    {0u, 65535u, 7500u}, /* sensor_1_pressure_low */
    {0u, 16368u, 15386u}, /* sensor_1_raw_high */
    {0u, 65535u, 57500u}, /* sensor_1_pressure_high */
    {0u, 16368u, 655u}, /* sensor_2_raw_low */
    {0u, 65535u, 7500u}, /* sensor_2_pressure_low */
    {0u, 16368u, 15386u}, /* sensor_2_raw_high */
    {0u, 65535u, 57500u}, /* sensor_2_pressure_high */
    {0u, 16368u, 655u}, /* sensor_3_raw_low */
    {0u, 65535u, 7500u}, /* sensor_3_pressure_low */
    {0u, 16368u, 15386u}, /* sensor_3_raw_high */
    {0u, 65535u, 57500u}, /* sensor_3_pressure_high */
    {0u, 16368u, 655u}, /* sensor_4_raw_low */
    {0u, 65535u, 7500u}, /* sensor_4_pressure_low */
    {0u, 16368u, 15386u}, /* sensor_4_raw_high */
    {0u, 65535u, 57500u}, /* sensor_4_pressure_high */
};

#define STORED_FIRST 6u
#define STORED_COUNT 18u

#endif
