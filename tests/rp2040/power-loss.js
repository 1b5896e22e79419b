// Losses of power while the journal is erased, and while the beginning of a job is written to it. The board must start
// again at rest and without a fault.
//
//   node cut.js GROWBOT IMAGE [SAMPLES]
//
// Losses are after every 256 bytes of the first block erased, and after every byte of the page with the record. SAMPLES
// is the number of each, by default 3. `all` takes about ten minutes.

import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { promisify } from 'node:util';
import { begunJob } from './job.js';
import { serve } from './serve.js';

const [growbot, image, samples = 3] = process.argv.slice(2);
assert(growbot && image, 'give the program and the ELF image: node cut.js GROWBOT IMAGE [SAMPLES]');
const run = promisify(execFile);

const { work, boardAt } = await begunJob(growbot, image);

/** Returns SAMPLES of these numbers, evenly spread. */
function some(numbers) {
    const count = samples === 'all' ? numbers.length : Math.min(Number(samples), numbers.length);
    return Array.from({ length: count }, (_, index) => numbers[Math.floor(((index + 0.5) * numbers.length) / count)]);
}

/** Returns a board that lost power after `bytes` bytes of work that begins at `from`, and whose power is on again. */
function cut(from, bytes) {
    const board = boardAt(from - 1000);
    assert(board.rom.busyUntil === null || board.chip.clock.nanos < from);
    board.flash.bytesLeft = bytes;
    board.run(1000);
    assert(board.flash.lostPower, `no power was lost after ${bytes} bytes`);
    board.powerUp();
    board.run(3000);
    return board;
}

/** Returns the status of the board. */
async function readStatus(board) {
    const { port, stop } = await serve(board);
    try {
        return JSON.parse((await run(growbot, ['status', '--json', '--port', port])).stdout);
    } finally {
        stop();
    }
}

const range = (count, step) => Array.from({ length: count }, (_, index) => index * step + 1);
let losses = 0;
for (const [what, numbers] of [
    ['erase', range(128, 256)],
    ['program', range(256, 1)],
]) {
    const { from } = work.find((one) => one.what === what);
    for (const bytes of some(numbers)) {
        const board = cut(from, bytes);
        const { state, fault } = await readStatus(board);
        assert.deepEqual({ state, fault }, { state: 'idle', fault: null }, `${what}, ${bytes} bytes`);
        assert.equal(board.resets, 0);
        losses += 1;
    }
}
console.log(`${losses} losses of power in the journal: each time the board started again, at rest`);
