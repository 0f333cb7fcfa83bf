#include "board.h"

#include <string.h>

enum { STORED_BYTES = 2 * STORED_COUNT + 2, POINTS = 4 };
enum { RAW_LOW, PRESSURE_LOW, RAW_HIGH, PRESSURE_HIGH };

static struct {
    modbus_server *server;
    uint16_t holding[HOLDING_COUNT];
    uint16_t raw[ADC_COUNT];
    uint16_t latched;
    uint16_t reset_cause;
    bool supply_known;
    bool supply_low;
    bool calibration_lost;
    uint32_t now_ms;
    uint32_t written_ms;
    uint32_t supply_good_ms;
} board;

static void latch(uint16_t cause)
{
    board.latched |= cause;
    board.holding[HOLDING_PUMP_DUTY] = 0;
    if (board.holding[HOLDING_SAFE_STATE] == 0)
        board.holding[HOLDING_OUTPUTS] = 0;
}

static const uint16_t *points_of(const uint16_t *holding, uint8_t sensor)
{
    return &holding[HOLDING_SENSOR_1_RAW_LOW + POINTS * sensor];
}

static bool in_range(const uint16_t *holding)
{
    for (uint8_t i = 0; i < HOLDING_COUNT; i++)
        if (holding[i] < HOLDING_RANGES[i].minimum || holding[i] > HOLDING_RANGES[i].maximum)
            return false;
    for (uint8_t sensor = 0; sensor < SENSOR_COUNT; sensor++)
        if (points_of(holding, sensor)[RAW_LOW] >= points_of(holding, sensor)[RAW_HIGH])
            return false;
    return true;
}

static void set_defaults(void)
{
    for (uint8_t i = 0; i < HOLDING_COUNT; i++)
        board.holding[i] = HOLDING_RANGES[i].default_value;
}

static void load(void)
{
    uint8_t bytes[STORED_BYTES];
    board.calibration_lost = true;
    if (!hal_load(bytes, STORED_BYTES))
        return;
    uint16_t kept = (uint16_t)(bytes[STORED_BYTES - 2] | (uint16_t)(bytes[STORED_BYTES - 1] << 8));
    if (modbus_crc(bytes, STORED_BYTES - 2) != kept)
        return;
    memcpy(&board.holding[STORED_FIRST], bytes, STORED_BYTES - 2);
    board.calibration_lost = !in_range(board.holding);
    if (board.calibration_lost)
        set_defaults();
}

static void store(void)
{
    uint8_t bytes[STORED_BYTES];
    memcpy(bytes, &board.holding[STORED_FIRST], STORED_BYTES - 2);
    uint16_t crc = modbus_crc(bytes, STORED_BYTES - 2);
    bytes[STORED_BYTES - 2] = (uint8_t)crc;
    bytes[STORED_BYTES - 1] = (uint8_t)(crc >> 8);
    hal_store(bytes, STORED_BYTES);
    board.calibration_lost = false;
}

void board_init(modbus_server *server, uint16_t reset_cause)
{
    memset(&board, 0, sizeof board);
    board.server = server;
    set_defaults();
    load();
    board.reset_cause = reset_cause;
    latch(LATCHED_RESET);
}

static uint16_t supply_mv(void)
{
    uint32_t mv = (uint32_t)board.raw[SENSOR_COUNT] * board.holding[HOLDING_SUPPLY_FULL_SCALE] / RAW_MAX;
    return (uint16_t)mv;
}

void board_poll(uint32_t now_ms)
{
    board.now_ms = now_ms;
    /* Multiplied out: the chip divides in no hardware, and would spend most of its loop on it. */
    uint32_t measured = (uint32_t)board.raw[SENSOR_COUNT] * board.holding[HOLDING_SUPPLY_FULL_SCALE];
    board.supply_low = board.supply_known && measured < (uint32_t)board.holding[HOLDING_SUPPLY_MINIMUM] * RAW_MAX;
    if (!board.supply_low)
        board.supply_good_ms = now_ms;
    else if (now_ms - board.supply_good_ms >= SUPPLY_LOW_MS && !(board.latched & LATCHED_SUPPLY_LOW))
        latch(LATCHED_SUPPLY_LOW);
    if (board.latched == 0 && now_ms - board.written_ms >= board.holding[HOLDING_WATCHDOG_MS])
        latch(LATCHED_HOST_SILENT);
}

void board_take_reading(uint8_t input, uint16_t raw)
{
    board.raw[input] = raw < RAW_MAX ? raw : RAW_MAX;
    if (input == SENSOR_COUNT)
        board.supply_known = true;
}

uint8_t board_solenoids(void)
{
    return (uint8_t)board.holding[HOLDING_OUTPUTS];
}

uint16_t board_pump_duty(void)
{
    return board.holding[HOLDING_PUMP_DUTY];
}

/* The line through the two points, bounded to what a register holds. */
static uint16_t pressure_of(uint8_t sensor)
{
    const uint16_t *points = points_of(board.holding, sensor);
    int32_t span = (int32_t)points[PRESSURE_HIGH] - points[PRESSURE_LOW];
    int32_t from_low = (int32_t)board.raw[sensor] - points[RAW_LOW];
    int32_t width = (int32_t)points[RAW_HIGH] - points[RAW_LOW];
    /* 65535 * 16368 fits into 31 bits */
    int32_t steps = points[PRESSURE_LOW] + span * from_low / width;
    return steps < 0 ? 0 : steps > 0xFFFF ? 0xFFFFu : (uint16_t)steps;
}

static uint16_t input_value(uint16_t address)
{
    switch (address) {
    case INPUT_PRESSURE_1:
    case INPUT_PRESSURE_2:
    case INPUT_PRESSURE_3:
    case INPUT_PRESSURE_4:
        return pressure_of((uint8_t)(address - INPUT_PRESSURE_1));
    case INPUT_LATCHED:
        return board.latched;
    case INPUT_FAULTS:
        return (uint16_t)((board.supply_low ? FAULTS_SUPPLY_LOW : 0) |
                          (board.calibration_lost ? FAULTS_CALIBRATION_LOST : 0));
    case INPUT_OUTPUTS_DRIVEN:
        return board_solenoids();
    case INPUT_PUMP_DUTY_DRIVEN:
        return board_pump_duty();
    case INPUT_SUPPLY:
        return supply_mv();
    case INPUT_RESET_CAUSE:
        return board.reset_cause;
    case INPUT_UPTIME_HIGH:
        return (uint16_t)(board.now_ms >> 16);
    case INPUT_UPTIME_LOW:
        return (uint16_t)board.now_ms;
    case INPUT_CHECK_SUM_ERRORS:
        return board.server->check_sum_errors;
    case INPUT_FRAMES:
        return board.server->frames;
    case INPUT_FIRMWARE_VERSION:
        return FIRMWARE_VERSION;
    case INPUT_REGISTER_VERSION:
        return REGISTER_VERSION;
    default:
        return board.raw[address - INPUT_RAW_1];
    }
}

uint8_t map_read_bit(bool coil, uint16_t address, bool *value)
{
    if (address >= (coil ? (uint16_t)COIL_COUNT : (uint16_t)DISCRETE_COUNT))
        return MODBUS_ILLEGAL_ADDRESS;
    if (address < COIL_COUNT)
        *value = (board_solenoids() >> address) & 1u;
    else
        *value = address == DISCRETE_PUMP_DRIVEN ? board_pump_duty() > 0 : board.latched != 0;
    return MODBUS_OK;
}

uint8_t map_read_register(bool input, uint16_t address, uint16_t *value)
{
    if (!input && address >= MIRROR_ADDRESS) {
        input = true;
        address = (uint16_t)(address - MIRROR_ADDRESS);
    }
    if (address >= (input ? (uint16_t)INPUT_COUNT : (uint16_t)HOLDING_COUNT))
        return MODBUS_ILLEGAL_ADDRESS;
    *value = input ? input_value(address) : board.holding[address];
    return MODBUS_OK;
}

/* Whether what is wanted energises a solenoid that is off, or runs the pump. */
static bool jams(const uint16_t *wanted)
{
    return (wanted[HOLDING_OUTPUTS] & (uint16_t)~board.holding[HOLDING_OUTPUTS]) != 0 || wanted[HOLDING_PUMP_DUTY] != 0;
}

static uint8_t take(uint16_t *wanted, bool acknowledges)
{
    if (!in_range(wanted))
        return MODBUS_ILLEGAL_VALUE;
    if (acknowledges && wanted[HOLDING_ACKNOWLEDGE] != board.latched)
        return MODBUS_ILLEGAL_VALUE;
    if (board.latched != 0 && jams(wanted))
        return MODBUS_DEVICE_FAILURE;
    bool stores = wanted[HOLDING_STORE] != 0;
    if (stores && (wanted[HOLDING_OUTPUTS] != 0 || wanted[HOLDING_PUMP_DUTY] != 0))
        return MODBUS_DEVICE_BUSY;
    if (acknowledges)
        board.latched = 0;
    wanted[HOLDING_ACKNOWLEDGE] = 0;
    wanted[HOLDING_STORE] = 0;
    memcpy(board.holding, wanted, sizeof board.holding);
    board.written_ms = board.now_ms;
    if (stores)
        store();
    return MODBUS_OK;
}

uint8_t map_write_coils(uint16_t address, uint16_t count, const uint8_t *packed)
{
    if (address >= COIL_COUNT || count > COIL_COUNT - address)
        return MODBUS_ILLEGAL_ADDRESS;
    uint16_t wanted[HOLDING_COUNT];
    memcpy(wanted, board.holding, sizeof wanted);
    for (uint16_t i = 0; i < count; i++) {
        uint16_t bit = (uint16_t)(1u << (address + i));
        if (packed[i / 8] & (1u << (i % 8)))
            wanted[HOLDING_OUTPUTS] |= bit;
        else
            wanted[HOLDING_OUTPUTS] &= (uint16_t)~bit;
    }
    return take(wanted, false);
}

uint8_t map_write_registers(uint16_t address, uint16_t count, const uint8_t *big_endian)
{
    if (address >= HOLDING_COUNT || count > HOLDING_COUNT - address)
        return MODBUS_ILLEGAL_ADDRESS;
    uint16_t wanted[HOLDING_COUNT];
    memcpy(wanted, board.holding, sizeof wanted);
    for (uint16_t i = 0; i < count; i++)
        wanted[address + i] = (uint16_t)((uint16_t)(big_endian[2 * i] << 8) | big_endian[2 * i + 1]);
    return take(wanted, address <= HOLDING_ACKNOWLEDGE && HOLDING_ACKNOWLEDGE < address + count);
}
