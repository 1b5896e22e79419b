// Runs the firmware of the Pico in rp2040js in real time, and connects `growbot` over TCP. At the start and after an
// emergency stop, heater, fan and both drivers must be off. The board must report the signals at its pins and channels,
// and a driver's fault.
//
//   node check.js GROWBOT IMAGE

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { promisify } from "node:util";
import { Board } from "./board.js";
import { rest, serve } from "./serve.js";

const [growbot, image] = process.argv.slice(2);
assert(growbot && image, "give the program and the ELF image: node check.js GROWBOT IMAGE");
const run = promisify(execFile);

/** Pins of growbot-firmware/boards/pico/pins.rs and their levels while all is off. EN is low when on. */
const OFF = { low: [8, 9, 10], high: [4, 7] };

function assertOff(board, when) {
    for (const pin of OFF.low) assert(board.isLow(pin), `${when}: pin ${pin} is not low`);
    for (const pin of OFF.high) assert(board.isHigh(pin), `${when}: pin ${pin} is not high`);
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
    const { robot, state, fault } = resting;
    assert.deepEqual({ robot, state, fault }, { robot: "growbot-a", state: "idle", fault: null });
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
faulty.put(11, false);
faulty.run(3000);
assertOff(faulty, "with a driver's fault");
const second = await serve(faulty);
try {
    const { stdout } = await run(growbot, ["status", "--json", "--port", second.port]);
    assert.equal(JSON.parse(stdout).fault, "driver-fault");
} finally {
    second.stop();
}

// With both lines connected, the board responds only on the line of the request.
const plugged = new Board(image, "usb");
rest(plugged);
plugged.run(3000);
assert(plugged.host.open, "the host has found no serial port");
const third = await serve(plugged);
try {
    for (const line of ["usb", "uart", "usb"]) {
        plugged.line = line;
        const others = plugged.unheard;
        const { stdout } = await run(growbot, ["status", "--json", "--port", third.port]);
        assert.equal(JSON.parse(stdout).state, "idle", line);
        assert.equal(plugged.unheard, others, `asked over ${line}, the board answered on the other line, too`);
    }
    await run(growbot, ["estop", "--port", third.port]);
    assertOff(plugged, "after the emergency stop over USB");
} finally {
    third.stop();
}
console.log("the firmware of the Pico in rp2040js: at rest, emergency stop, driver's fault, both lines: passed");
