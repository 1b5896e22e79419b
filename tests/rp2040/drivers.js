// An SKR Pico in rp2040js that is configured over the line. Its drivers get the settings of the robot file, and get
// them again after they have lost them at rest. While the robot works, a driver that does not respond, stalls, is
// shorted or restarts causes a specific `driver-fault`, with everything off. No motor is energised before both drivers
// are configured.
//
//   node drivers.js GROWBOT IMAGE
//
// The image has no robot built in.

import assert from 'node:assert/strict';
import { execFile, spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { promisify } from 'node:util';
import { serve } from './serve.js';
import { REGISTERS, STANDS, TURNS } from './tmc2209.js';

const { CHOPCONF, DRV_STATUS, GCONF, GSTAT, IFCNT, IHOLD_IRUN, SGTHRS, SG_RESULT, TSTEP } = REGISTERS;
const [growbot, image] = process.argv.slice(2);
assert(growbot && image, 'give the program and the ELF image: node drivers.js GROWBOT IMAGE');
const run = promisify(execFile);

/** Addresses of the drivers of head and feed. */
const [HEAD, FEED] = [0, 3];
/** Pins of the SKR Pico from growbot-core/src/robot/board.rs. */
const PINS = {
    head_enable: 12,
    feed_enable: 15,
    heater: 23,
    heater_enable: 21,
    fan: 17,
    filament_presence: 16,
    index: 4,
    emergency_stop: 3,
    orientation_data: 29,
    orientation_clock: 22,
    thermistor: 27,
};
process.env.RP2040_PINS = JSON.stringify(PINS);
const { Board } = await import('./board.js');
/** Levels while all is off. EN is low when on. */
const OFF = { low: [PINS.heater, PINS.heater_enable, PINS.fan], high: [PINS.head_enable, PINS.feed_enable] };
const LOW = 0;
/** Max time of the chip from a driver's trouble to everything off, ms: a few readings, then two polls at 10 Hz. */
const FOUND_MS = 400;

/** Robot A on an SKR Pico. */
const ROBOT = readFileSync(new URL('../../robots/growbot-a.toml', import.meta.url), 'utf8')
    .replace(/^(supply = true|driver_fault = ).*$/gm, '')
    .concat(
        '\n[board]\nkind = "skr-pico"\n',
        '[head.driver]\ncurrent_a = 0.8\nstall_threshold = 50\n',
        '[feed.driver]\ncurrent_a = 0.5\nmicrosteps = 32\nmode = "spreadcycle"\n',
    );

/** Returns a board with this flash, whose power is on. */
function newBoard(flash, prepare = () => {}) {
    const board = new Board(image);
    if (flash) board.chip.flash.set(flash);
    // 25 C, off the index mark, with filament, stop not pressed.
    board.convert(PINS.thermistor - 26, 3911);
    board.put(PINS.index, true);
    board.put(PINS.filament_presence, false);
    board.put(PINS.emergency_stop, false);
    prepare(board.driverLine.drivers);
    return board;
}

const folder = mkdtempSync(join(tmpdir(), 'growbot-'));
const file = join(folder, 'skr.toml');
writeFileSync(file, ROBOT);
process.on('exit', () => rmSync(folder, { recursive: true }));

/** Configures a board, and returns its flash. */
async function configured() {
    const board = newBoard();
    board.run(3000);
    const { port, stop } = await serve(board);
    try {
        await run(growbot, ['configure', file, '--port', port]);
    } finally {
        stop();
    }
    return board.chip.flash.slice();
}

function assertOff(board, when) {
    for (const pin of OFF.low) assert(board.isLow(pin), `${when}: pin ${pin} is not low`);
    for (const pin of OFF.high) assert(board.isHigh(pin), `${when}: pin ${pin} is not high`);
}

/** Checks the registers: GSTAT cleared, GCONF for control by line and registers, IHOLD and IRUN, CHOPCONF with
 * microsteps, and SGTHRS. */
function assertConfigured({ drivers }) {
    const found = (node) =>
        [GSTAT, GCONF, IHOLD_IRUN, CHOPCONF, SGTHRS].map((register) => drivers[node].registers.get(register));
    // Head: 26/32 of 0.98 A, 16 microsteps. Feed: 16/32, 32 microsteps, SpreadCycle.
    assert.deepEqual(found(HEAD), [0, 0x1c0, 0x11919, 0x14028053, 50]);
    assert.deepEqual(found(FEED), [0, 0x1c4, 0x10f0f, 0x13028053, 0]);
}

function configures(flash) {
    const board = newBoard(flash);
    board.run(1000);
    assertConfigured(board.driverLine);
    const counts = () => board.driverLine.drivers.map(({ registers }) => registers.get(IFCNT));
    assert.deepEqual(counts(), [12, 0, 0, 12], 'no other driver is written to');
    board.run(1000);
    assert.deepEqual(counts(), [12, 0, 0, 12], 'drivers are only read once they are configured');
    board.driverLine.drivers[HEAD].startAnew();
    board.run(1000);
    assertConfigured(board.driverLine);
    assertOff(board, 'with its drivers configured');
}

/** Begins a growth on a board, breaks a driver, and checks the fault. Returns the time until all is off, ms. */
async function breaks(what, board, change, trouble) {
    let [energised, off] = [false, 0];
    board.run(3000);
    board.onPin = (pin, state) => {
        energised ||= OFF.high.includes(pin) && state === LOW;
        if (OFF.low.includes(pin)) off = board.ns;
    };
    const { port, stop } = await serve(board);
    try {
        const growth = spawn(growbot, ['grow', '--to', '0,0,40,0,90', '--robot', file, '--port', port], {
            stdio: ['ignore', 'ignore', 'pipe'],
        });
        let output = '';
        growth.stderr.on('data', (text) => (output += text));
        const ended = once(growth, 'close');
        const until = Date.now() + 600e3;
        while (growth.exitCode === null && !OFF.low.some((pin) => board.isHigh(pin))) {
            assert(Date.now() < until, `${what}: the board does not heat: ${output}`);
            await new Promise((later) => setTimeout(later, 5));
        }
        const begun = board.ns;
        change(board.driverLine.drivers);
        await ended;
        assert.match(output, /driver-fault/, what);
        assertOff(board, what);
        const status = JSON.parse((await run(growbot, ['status', '--json', '--port', port])).stdout);
        assert.equal(status.fault, 'driver-fault', what);
        assert.deepEqual(status.latest_fault.sensors.driver_problem, trouble, what);
        assert(!energised, `${what}: a motor was energised`);
        const ms = (off - begun) / 1e6;
        assert(ms < FOUND_MS, `${what}: all is off after ${ms} ms`);
        return ms;
    } finally {
        stop();
    }
}

const CASES = [
    ['silent', (drivers) => (drivers[FEED].silent = true), { motor: 'feed', problem: 'silent' }],
    ['started anew', (drivers) => drivers[HEAD].startAnew(), { motor: 'head', problem: 'reset' }],
    [
        'shorted',
        (drivers) => drivers[FEED].registers.set(DRV_STATUS, STANDS | 4),
        { motor: 'feed', problem: 'short-to-ground' },
    ],
    [
        'stalled',
        ([{ registers }]) => registers.set(DRV_STATUS, TURNS).set(TSTEP, 100).set(SG_RESULT, 20),
        { motor: 'head', problem: 'stall' },
    ],
];

const flash = await configured();
configures(flash);
const silent = newBoard(flash, (drivers) => (drivers[HEAD].silent = true));
const [, ...found] = await Promise.all([
    breaks('silent from the start', silent, () => {}, { motor: 'head', problem: 'silent' }),
    ...CASES.map(([what, change, trouble]) => breaks(what, newBoard(flash), change, trouble)),
]);
const times = CASES.map(([what], index) => `${what} ${found[index].toFixed(0)} ms`);
console.log(`drivers of an SKR Pico in rp2040js: configured; all off in trouble: ${times.join(', ')}`);
