// A job that begins on a board whose journal is full, so that it has to be erased. The messages of `growbot` are
// recorded with the chip's times, and replayed to new boards, which all behave the same.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { Board } from './board.js';
import { rest, serve } from './serve.js';

/** Address range of the journal in the flash (growbot-firmware/memory/pico.x). */
export const JOURNAL = [0x1c0000, 0x200000];

function newBoard(image, line) {
    const board = new Board(image, line);
    rest(board);
    board.chip.flash.fill(0, ...JOURNAL);
    return board;
}

/** Begins a job with growbot. Returns the messages sent, and the flash operations: kind, begin and end, ns. */
async function record(growbot, image, line) {
    const board = newBoard(image, line);
    const work = [];
    board.rom.onWork = (what, from, until) => work.push({ what, from, until });
    board.run(3000);
    const sent = [];
    const { port, stop } = await serve(board, (bytes) => sent.push([board.ns, [...bytes]]));
    const child = spawn(growbot, ['grow', '--to', '0,0,40,0,90', '--port', port], { stdio: 'ignore' });
    const until = Date.now() + 600e3;
    while (!(work.some(({ what }) => what === 'program') && work.some(({ what }) => what === 'erase'))) {
        assert(Date.now() < until, `no job was begun: the flash has done ${JSON.stringify(work)}`);
        await new Promise((later) => setTimeout(later, 20));
    }
    child.kill();
    stop();
    return { sent, work };
}

/** Returns a board that has received the recorded messages up to a time. */
function boardAt(image, line, sent, ns) {
    const board = newBoard(image, line);
    for (const [when, bytes] of sent) {
        if (when >= ns) break;
        board.runUntil(when);
        board.send(bytes);
    }
    board.runUntil(ns);
    return board;
}

/** Begins the job once over a line. Returns the flash operations, and functions that create boards at a time, ns. */
export async function begunJob(growbot, image, line = 'uart') {
    const { sent, work } = await record(growbot, image, line);
    return { work, newBoard: () => newBoard(image, line), boardAt: (ns) => boardAt(image, line, sent, ns) };
}
