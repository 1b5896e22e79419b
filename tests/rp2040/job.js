// A job that is begun on a board whose journal is full, so that it has to be erased. What `growbot` sends is recorded,
// with the chip's times, and played to new boards: each does the same.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { Board } from './board.js';
import { rest, serve } from './serve.js';

/** Where the journal is in the flash (growbot-firmware/memory/pico.x). */
export const JOURNAL = [0x1c0000, 0x200000];

function newBoard(image, line) {
    const board = new Board(image, line);
    rest(board);
    board.chip.flash.fill(0, ...JOURNAL);
    return board;
}

/** Has growbot begin a job. Gives what it sent, and the flash's work: what, from when and until when, ns. */
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

/** A board that has come to a time, by what was sent to it. */
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

/** Begins the job once, over a line. Gives the flash's work, and boards that have come to a time of it, ns. */
export async function begunJob(growbot, image, line = 'uart') {
    const { sent, work } = await record(growbot, image, line);
    return { work, newBoard: () => newBoard(image, line), boardAt: (ns) => boardAt(image, line, sent, ns) };
}
