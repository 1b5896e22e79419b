// Runs the firmware of the Pico in rp2040js, in step with the clock on the wall, and lets `growbot` talk to it over TCP:
// at its start and after an emergency stop the heater, the fan and both drivers are off; what lies at the pins and at the
// converter's channels is what the board tells its host; a driver's fault is one.
//
//   node check.js GROWBOT IMAGE

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { createServer } from "node:net";
import { promisify } from "node:util";
import { Board } from "./board.js";

const [growbot, image] = process.argv.slice(2);
assert(growbot && image, "give the program and the ELF image: node check.js GROWBOT IMAGE");
const run = promisify(execFile);

/** The pins of growbot-firmware/boards/pico/pins.rs that must be at a level while all is off, and with an EN that is low when on. */
const OFF = { low: [8, 9, 10], high: [4, 7] };

function assertOff(board, when) {
    for (const pin of OFF.low) assert(board.isLow(pin), `${when}: pin ${pin} is not low`);
    for (const pin of OFF.high) assert(board.isHigh(pin), `${when}: pin ${pin} is not high`);
}

/** Puts the signals of a robot at rest to the board, at 25 C and 12 V. */
function rest(board) {
    const { adc, gpio } = board.chip;
    // 100 kOhm below 4.7 kOhm; 12 V of 36.3 V.
    [adc.channelValues[0], adc.channelValues[1]] = [3911, 1354];
    // Drivers well; filament; no mark; stop not pressed.
    for (const [pin, level] of [[11, true], [12, false], [14, true], [15, false]]) gpio[pin].setInputValue(level);
}

/** Puts a board behind a TCP port, and lets it live as time passes. */
async function serve(board) {
    let line;
    const arrived = [];
    const server = createServer((socket) => {
        line = socket.setNoDelay(true);
        socket.on("data", (bytes) => arrived.push(...bytes));
        socket.on("error", () => {});
    });
    await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
    const timer = setInterval(() => {
        board.run(10);
        while (arrived.length) board.send([arrived.shift()]);
        if (board.sent.length && line?.writable) line.write(Buffer.from(board.sent.splice(0)));
    }, 10);
    const stop = () => {
        clearInterval(timer);
        line?.destroy();
        server.close();
    };
    return { port: `tcp:127.0.0.1:${server.address().port}`, stop };
}

const board = new Board(image);
rest(board);
board.run(100);
assertOff(board, "100 ms after the start");
board.run(2900);
const { port, stop } = await serve(board);
const status = async () => JSON.parse((await run(growbot, ["status", "--json", "--port", port])).stdout);
try {
    const resting = await status();
    assert.deepEqual([resting.robot, resting.state, resting.fault], ["growbot-a", "idle", null], JSON.stringify(resting));
    assert(Math.abs(resting.temperature_c - 25) < 0.5, `${resting.temperature_c} C, and 25 C at the converter`);
    assert(Math.abs(resting.sensors.supply_v - 12) < 0.05, `${resting.sensors.supply_v} V, and 12 V at the converter`);
    await run(growbot, ["estop", "--port", port]);
    assertOff(board, "after the emergency stop");
    const stopped = await status();
    assert.equal(stopped.state, "emergency-stop", JSON.stringify(stopped));
    assert.equal(board.resets, 0, "the watchdog has reset the board");
} finally {
    stop();
}

const faulty = new Board(image);
rest(faulty);
faulty.chip.gpio[11].setInputValue(false);
faulty.run(3000);
assertOff(faulty, "with a driver's fault");
const second = await serve(faulty);
try {
    const { stdout } = await run(growbot, ["status", "--json", "--port", second.port]);
    assert.equal(JSON.parse(stdout).fault, "driver-fault");
} finally {
    second.stop();
}
console.log(`the firmware of the Pico in rp2040js: at rest, emergency stop, driver's fault: all as it should be`);
