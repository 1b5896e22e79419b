// The other end of growbot's port `rp2040` (growbot-sim/src/port/rp2040.rs). It runs a Pico step by step, on requests
// over standard input and output.
//
//   node emulator-server.js IMAGE [LINE]
//
// LINE is the line of the link, `uart` or `usb`, by default `uart`.
//
// A message is its length (32 bits) and its bytes. Numbers are little-endian. A request begins with its kind:
//
// - 0, run. Its fields are the end (f64, ns since the power came on), max head steps and feed steps (2 x u32), and
//   counts at the thermistor's and the supply's channel (2 x u16, 65535: the converter never gets ready). Then come
//   levels of INPUTS, a bit each (u8), gravity along the orientation sensor's axes, 1/1000 g (3 x i16, -32768: the
//   sensor does not respond), and bytes for the link.
// - 1, lose power after this many more bytes of flash are programmed or erased (u32).
// - 2, power up.
// - 3, slow flash: ratio of the duration of its operations to the typical one (f64).
// - 4, crash (u8): the main loop hangs (0), the processor faults (1), or the crystal stops (2) from now on.
// - 5, save the contents of the flash.
// - 6, restore these contents: the power goes and comes again.
//
// Each response has the time (f64, ns), the fractions of the time since the last response in which heater and fan were
// on (2 x f64), and the instructions executed so far (f64). Then come resets by the watchdog (u32), bytes of flash
// changed (u32), whether power is lost (u32), and the number of edges (u32). Each edge is its time after the last
// response (u32, ns) and a code (u32): the index in OUTPUTS times 4, plus 0 for low, 1 for high, 2 for not driven.
// Bytes from the link come last.
//
// With RP2040_FIGURES=FILE it writes the cost of the step interrupt and the depth of the stack (figures.js).
import { readSync, writeSync } from 'node:fs';
import { Board } from './board.js';
import { measure } from './figures.js';
import { ADC, FAN, HEATER, INPUTS, OUTPUTS } from './pins.js';

const [LOW, HIGH, FLOATING] = [0, 1, 2];
const SILENT = 0xffff;

const board = new Board(process.argv[2], process.argv[3]);
if (process.env.RP2040_FIGURES) measure(board.chip.core, process.env.RP2040_FIGURES);
/** Edges since the last response: times and codes. */
let edges = [];
let begun = 0;
/** Saved contents of the flash. */
let kept;
/** Remaining numbers of steps of head and feed. */
const left = [Infinity, Infinity];
/** For heater and fan: the time since which it is on, null while it is off, and the time for which it was on, ns. */
const power = new Map([HEATER, FAN].map((pin) => [pin, { since: null, ns: 0 }]));
const signals = new Map(OUTPUTS.map((pin, index) => [pin, index]));
const STEPS = [OUTPUTS[0], OUTPUTS[3]];

board.onPin = (pin, state) => {
    const { ns } = board;
    const powered = power.get(pin);
    if (powered) {
        if (powered.since !== null) powered.ns += ns - powered.since;
        powered.since = state === HIGH ? ns : null;
        return;
    }
    const signal = signals.get(pin);
    if (signal === undefined) return;
    const axis = STEPS.indexOf(pin);
    // The end of a step's pulse is not reported.
    if (axis >= 0 && state !== HIGH) return;
    edges.push(Math.floor(ns - begun), (signal << 2) | state);
    if (axis >= 0 && --left[axis] <= 0) board.interrupted = true;
};

function take(buffer) {
    for (let at = 0; at < buffer.length; ) {
        const got = readSync(0, buffer, at, buffer.length - at, null);
        if (got === 0) process.exit(0);
        at += got;
    }
    return buffer;
}

function give(buffer) {
    for (let at = 0; at < buffer.length; ) at += writeSync(1, buffer, at);
}

function run(request) {
    const until = request.readDoubleLE(1);
    left[0] = request.readUInt32LE(9);
    left[1] = request.readUInt32LE(13);
    ADC.forEach((channel, index) => {
        if (channel === undefined) return;
        const counts = request.readUInt16LE(17 + 2 * index);
        board.convert(channel, counts === SILENT ? null : counts);
    });
    const levels = request[21];
    INPUTS.forEach((pin, index) => pin !== undefined && board.put(pin, (levels & (1 << index)) !== 0));
    const gravity = [22, 24, 26].map((at) => request.readInt16LE(at));
    board.orientation.gravity = gravity[0] === -32768 ? null : gravity;
    if (request.length > 28) board.send(request.subarray(28));
    board.runUntil(until);
}

/** Returns the fraction of a time in which a pin was on. */
function share(pin, time) {
    const powered = power.get(pin);
    if (powered.since !== null) {
        powered.ns += board.ns - powered.since;
        powered.since = board.ns;
    }
    const ns = powered.ns;
    powered.ns = 0;
    return time > 0 ? ns / time : 0;
}

function answer() {
    const time = board.ns - begun;
    const buffer = Buffer.alloc(52 + 4 * edges.length + board.sent.length);
    buffer.writeUInt32LE(buffer.length - 4, 0);
    buffer.writeDoubleLE(board.ns, 4);
    buffer.writeDoubleLE(share(HEATER, time), 12);
    buffer.writeDoubleLE(share(FAN, time), 20);
    buffer.writeDoubleLE(board.instructions, 28);
    buffer.writeUInt32LE(board.resets, 36);
    buffer.writeUInt32LE(board.flash.changed, 40);
    buffer.writeUInt32LE(board.flash.lostPower ? 1 : 0, 44);
    buffer.writeUInt32LE(edges.length / 2, 48);
    edges.forEach((word, index) => buffer.writeUInt32LE(word, 52 + 4 * index));
    buffer.set(board.sent, 52 + 4 * edges.length);
    give(buffer);
    [edges, begun] = [[], board.ns];
    board.sent.length = 0;
}

const WORK = [
    run,
    (request) => (board.flash.bytesLeft = request.readUInt32LE(1)),
    () => board.powerUp(),
    (request) => (board.flash.slowness = request.readDoubleLE(1)),
    (request) => [() => board.hang(), () => board.fault(), () => board.stopCrystal()][request[1]](),
    () => (kept = board.chip.flash.slice()),
    () => {
        board.chip.flash.set(kept);
        board.powerUp();
    },
];

for (;;) {
    const length = take(Buffer.alloc(4)).readUInt32LE(0);
    const request = take(Buffer.alloc(length));
    WORK[request[0]](request);
    answer();
}
