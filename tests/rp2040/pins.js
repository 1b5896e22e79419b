// Pins of the board: those of a Pico from growbot-core/src/robot/board.rs, or those of RP2040_PINS. It is JSON with a
// number for each existing signal.

const PICO = {
    head_step: 2,
    head_direction: 3,
    head_enable: 4,
    feed_step: 5,
    feed_direction: 6,
    feed_enable: 7,
    heater: 8,
    heater_enable: 9,
    fan: 10,
    driver_fault: 11,
    filament_presence: 12,
    filament_motion: 13,
    index: 14,
    emergency_stop: 15,
    orientation_data: 16,
    orientation_clock: 17,
    thermistor: 26,
    supply: 27,
};

const pins = process.env.RP2040_PINS ? JSON.parse(process.env.RP2040_PINS) : PICO;

/** STEP, DIR and EN of the head and of the feed, and the heater's second switch. */
export const OUTPUTS = [
    pins.head_step,
    pins.head_direction,
    pins.head_enable,
    pins.feed_step,
    pins.feed_direction,
    pins.feed_enable,
    pins.heater_enable,
];
/** Index sensor, filament encoder, filament presence, drivers' fault, emergency stop. Missing ones are undefined. */
export const INPUTS = [
    pins.index,
    pins.filament_motion,
    pins.filament_presence,
    pins.driver_fault,
    pins.emergency_stop,
];
/** Channels of the converter: thermistor and supply. Missing ones are undefined. */
export const ADC = [pins.thermistor, pins.supply].map((pin) => (pin === undefined ? undefined : pin - 26));
export const HEATER = pins.heater;
export const FAN = pins.fan;
/** Bus of the orientation sensor. */
export const ORIENTATION_DATA = pins.orientation_data;
export const ORIENTATION_CLOCK = pins.orientation_clock;
