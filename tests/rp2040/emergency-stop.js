// Emergency stops by the link switch everything off within a millisecond of the chip's time: while the flash erases a
// sector or programs a page, after a full queue, and while the main loop hangs. The bench switches heater and drivers
// on before.
//
//   node stop.js GROWBOT IMAGE [MOMENTS [LINE]]
//
// `growbot` begins a job on a board whose journal is full, so that it has to be erased. Its messages are recorded with
// the chip's times, and replayed to a new board for each of the moments, by default 4 of each kind. The line is `uart`
// or `usb`, by default both.

import assert from 'node:assert/strict';
import { begunJob } from './job.js';
import { FAN, HEATER, OUTPUTS } from './pins.js';

const [growbot, image, moments = 4, only] = process.argv.slice(2);
assert(growbot && image, 'give the program and the ELF image: node stop.js GROWBOT IMAGE [MOMENTS [LINE]]');

/** growbot-core/src/link/emergency_stop.rs */
const STOP = [0x00, 0xe5, 0x70, 0x9e, 0xe5, 0x70, 0x9e, 0x00];
const LIMIT_NS = 1e6;
const [HEAD_ENABLE, FEED_ENABLE, HEATER_ENABLE] = [OUTPUTS[2], OUTPUTS[5], OUTPUTS[6]];
const [SIO_SET, SIO_CLEAR, PWM_HEATER] = [0xd0000014, 0xd0000018, 0x40050000 + (HEATER / 2) * 0x14 + 0xc];
/** Number of bytes that overflows the board's queue. */
const FLOOD = 6000;

/** Returns a board whose main loop hangs from a time on, so that its watchdog is not fed any more. */
function hung(boardAt, ns) {
    const board = boardAt(ns);
    board.hang();
    return board;
}

function switchOn({ chip }) {
    chip.writeUint32(SIO_SET, 1 << HEATER_ENABLE);
    chip.writeUint32(SIO_CLEAR, (1 << HEAD_ENABLE) | (1 << FEED_ENABLE));
    chip.writeUint32(PWM_HEATER, 0xffff);
}

const isOff = (board) =>
    [HEATER, FAN, HEATER_ENABLE].every((pin) => board.isLow(pin)) &&
    [HEAD_ENABLE, FEED_ENABLE].every((pin) => board.isHigh(pin));

/** Sends a stop to a board, and returns the time from the last byte until all is off, ns. */
function stopped(board) {
    board.dropUnsent();
    board.send(STOP);
    while (board.coming.length) board.runUntil(Math.max(board.ns + 8, board.before + board.nextByte));
    // Over USB the time starts when the host has the bytes to send.
    const from = board.ns;
    assert(!isOff(board), 'all was off before the stop');
    while (!isOff(board)) {
        assert(board.ns - from < LIMIT_NS, `not off ${LIMIT_NS} ns after the stop`);
        board.runUntil(board.ns + 1000);
    }
    const took = board.ns - from;
    // Everything stays off, so neither the step interrupt nor the main loop switches on again.
    board.run(5);
    assert(isOff(board), 'it was switched on again');
    return took;
}

/** Returns the longest times over a line, ns. */
async function longestOver(line) {
    const { boardAt, work } = await begunJob(growbot, image, line);
    const longest = {};
    function note(what, ns) {
        longest[what] = Math.max(longest[what] ?? 0, ns);
    }
    for (const what of ['erase', 'program']) {
        const { from, until } = work.find((one) => one.what === what);
        for (let moment = 0; moment < moments; moment++) {
            const last = from + ((until - from) * (moment + 0.5)) / moments;
            // On the UART the stop's bytes take 0.7 ms, longer than programming a page. The first bytes are sent
            // before, so that the last byte arrives during the operation.
            const board = boardAt(line === 'usb' ? last : last - (STOP.length * 1e10) / 115200);
            switchOn(board);
            note(what, stopped(board));
        }
    }
    for (let moment = 0; moment < moments; moment++) {
        const when = 2.5e9 + moment * 31_000;
        const board = hung(boardAt, when);
        switchOn(board);
        note('hung main loop', stopped(board));
        const flooded = hung(boardAt, when);
        flooded.send(new Array(FLOOD).fill(0x55));
        while (flooded.isSentTo) flooded.run(1);
        switchOn(flooded);
        note('full queue', stopped(flooded));
    }
    return longest;
}

for (const line of only ? [only] : ['uart', 'usb']) {
    for (const [what, ns] of Object.entries(await longestOver(line))) {
        console.log(`emergency stop over ${line}, ${what}: off within ${(ns / 1000).toFixed(0)} us`);
    }
}
