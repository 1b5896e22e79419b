// Starts a Pico in rp2040js from the UF2 file that was copied to its drive. `growbot` configures it and checks that the
// image is sound and without a fault, and that the board obeys an emergency stop.
//
//   node pico.js UF2 GROWBOT [ARGUMENT...]
//
// The arguments after the file are the command that runs growbot.

import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { promisify } from 'node:util';
import { Board } from '../rp2040/board.js';
import { rest, serve } from '../rp2040/serve.js';

const [image, program, ...before] = process.argv.slice(2);
assert(image && program, 'give the UF2 file and the program: node pico.js UF2 GROWBOT');
const run = promisify(execFile);

const board = new Board(image);
rest(board);
board.run(3000);
const { port, stop } = await serve(board);
const growbot = async (...args) => (await run(program, [...before, ...args, '--port', port])).stdout;
const status = async () => JSON.parse(await growbot('status', '--json'));
try {
    const fresh = await status();
    assert.equal(fresh.image.check, 'sound', JSON.stringify(fresh));
    await growbot('configure', 'growbot-a');
    const { robot, state, fault, image } = await status();
    const found = { robot, state, fault, check: image.check };
    assert.deepEqual(found, { robot: 'growbot-a', state: 'idle', fault: null, check: 'sound' });
    await growbot('estop');
    assert.equal((await status()).state, 'emergency-stop');
    const result = `image sound (CRC ${image.crc}), configured, stopped`;
    console.log(`a Pico in rp2040js has started from the UF2 file: ${result}`);
} finally {
    stop();
}
