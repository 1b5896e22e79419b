// A Pico in rp2040js in virtual time, with an ELF image or a UF2 file. The image starts at its vector table, after the
// second-stage loader. The boot ROM has only the functions that change flash (rom.js).
//
// A reset by the watchdog resets the whole chip, except for its memory.
import { readFileSync } from 'node:fs';
import { GPIOPinState, RP2040 } from 'rp2040js';
import { BYTES, Flash } from './flash.js';
import { Orientation } from './orientation.js';
import { ORIENTATION_CLOCK, ORIENTATION_DATA } from './pins.js';
import { Rom } from './rom.js';
import { DriverLine } from './tmc2209.js';
import { UsbHost } from './usb.js';

const FLASH = 0x10000000;
const VECTORS = FLASH + 0x100;
/** Duration of a clock at 125 MHz, ns. */
const CLOCK_NS = 8;
/** Duration of a byte on the link at 115200 baud, ns. */
const BYTE_NS = 1e10 / 115200;
const PINS = 30;
/** Key of the watchdog among the emulator's peripherals. */
const WATCHDOG = 0x40058;
/** Key of the timer, and its registers of the time. */
const TIMER = 0x40054;
const TIMES = [0x24, 0x28];
/** Instructions that wait for an interrupt in a loop, and their address in the ROM. */
const [HANG, HANG_AT] = [0xe7fdbf30, 0x400];
/** Number of the exception. */
const HARD_FAULT = 3;

/** First words of a block of a UF2 file, and its size in bytes. */
const [UF2, BLOCK] = [0x0a324655, 512];

/** Returns the parts of an image, a UF2 file or a 32-bit ELF image, for the flash: address and bytes. */
function parts(image) {
    const isUf2 = image.length >= BLOCK && image.readUInt32LE(0) === UF2;
    return isUf2 ? blocks(image) : segments(image);
}

/** Returns the blocks of a UF2 file. */
function blocks(uf2) {
    return Array.from({ length: uf2.length / BLOCK }, (_, index) => {
        const at = index * BLOCK;
        return [uf2.readUInt32LE(at + 12), uf2.subarray(at + 32, at + 32 + uf2.readUInt32LE(at + 16))];
    });
}

/** Returns the loaded segments of an ELF image. */
function segments(elf) {
    const view = new DataView(elf.buffer, elf.byteOffset, elf.byteLength);
    const [table, size, count] = [view.getUint32(28, true), view.getUint16(42, true), view.getUint16(44, true)];
    const headers = Array.from({ length: count }, (_, index) => table + index * size);
    return headers
        .filter((at) => view.getUint32(at, true) === 1 && view.getUint32(at + 16, true) > 0)
        .map((at) => {
            const offset = view.getUint32(at + 4, true);
            return [view.getUint32(at + 12, true), elf.subarray(offset, offset + view.getUint32(at + 16, true))];
        });
}

/** Accesses that the emulator does not support end the emulation. The exception is the cause of the reset, which the
 * emulator reads as ones. */
const LOGGER = {
    debug() {},
    info() {},
    warn(part, message) {
        if (!message.startsWith('Unimplemented peripheral')) this.error(part, message);
    },
    error(part, message) {
        throw new Error(`${part}: ${message}`);
    },
};

export class Board {
    /** Creates a board with an image and switches its power on. The line is `uart` or `usb`, and `usb` plugs USB in. */
    constructor(image, line = 'uart') {
        [this.line, this.plugged] = [line, line === 'usb'];
        /** Bytes that the board has sent on the other line. */
        this.unheard = 0;
        const cells = new Uint8Array(BYTES).fill(0xff);
        for (const [address, bytes] of parts(readFileSync(image))) cells.set(bytes, address - FLASH);
        this.flash = new Flash(cells);
        /** Bytes that the board has sent. */
        this.sent = [];
        /** Bytes on their way to the board, and the time at which the next one arrives, ns of the chip. */
        [this.coming, this.nextByte] = [[], 0];
        /** Number of resets by the watchdog. */
        this.resets = 0;
        /** Number of instructions executed. */
        this.instructions = 0;
        /** Levels at the pins, from outside. */
        this.levels = new Array(PINS).fill(false);
        /** Counts at the converter's channels. */
        this.counts = [0, 0, 0, 0, 0];
        this.orientation = new Orientation();
        /** Stepper drivers at UART1. */
        this.driverLine = new DriverLine();
        /** Called with a pin and its new state: driven low (0), driven high (1), not driven (2). */
        this.onPin = () => {};
        /** Ends `run` early. */
        this.interrupted = false;
        /** Time that passed before the chip's latest start, ns. */
        this.before = 0;
        this.#start();
    }

    /** Updates the lines of the orientation sensor, which both the sensor and the board may pull low. */
    #orientationBus() {
        const { orientation } = this;
        const [clock, data] = [ORIENTATION_CLOCK, ORIENTATION_DATA].map((pin) => !this.isLow(pin));
        orientation.see(clock, data);
        this.put(ORIENTATION_CLOCK, clock);
        this.put(ORIENTATION_DATA, orientation.data);
    }

    /** Starts the chip. After a reset it has the memory of the previous chip. */
    #start(reset) {
        if (reset) this.before += reset.clock.nanos;
        const chip = new RP2040();
        chip.logger = LOGGER;
        chip.flash.set(this.flash.cells);
        this.flash.cells = chip.flash;
        if (reset) {
            chip.sram.set(reset.sram);
            chip.peripherals[WATCHDOG].reason = reset.peripherals[WATCHDOG].reason;
        }
        this.driverLine.join(chip);
        chip.uart[0].onByte = (byte) => this.#hear('uart', [byte]);
        this.host = this.plugged ? new UsbHost(chip, (bytes) => this.#hear('usb', bytes)) : null;
        const watchdog = chip.peripherals[WATCHDOG];
        watchdog.onWatchdogTrigger = () => {
            this.triggered = true;
            // Otherwise it would trigger repeatedly at the same time.
            watchdog.alarm.enable = false;
        };
        chip.adc.channelValues = this.counts;
        const convert = chip.adc.onADCRead;
        chip.adc.onADCRead = (channel) => this.counts[channel] !== null && convert(channel);
        chip.gpio.forEach((gpio, pin) => {
            gpio.setInputValue(this.levels[pin]);
            gpio.addListener((value) => this.onPin(pin, Math.min(value, GPIOPinState.Input)));
        });
        for (const pin of [ORIENTATION_CLOCK, ORIENTATION_DATA]) {
            chip.gpio[pin].addListener(() => this.#orientationBus());
        }
        const { core } = chip;
        // The emulator enters a handler with the thumb bit in its program counter. Jump tables would then read an odd
        // address.
        const enter = core.exceptionEntry.bind(core);
        core.exceptionEntry = (exception) => {
            enter(exception);
            core.PC &= ~1;
        };
        core.VTOR = VECTORS;
        core.SP = chip.readUint32(VECTORS);
        core.PC = chip.readUint32(VECTORS + 4) & ~1;
        [this.chip, this.triggered] = [chip, false];
        this.#orientationBus();
        this.rom = new Rom(chip, this.flash);
        [this.coming, this.nextByte] = [[], 0];
    }

    /** Returns the time since the power first came on, ns. */
    get ns() {
        return this.before + this.chip.clock.nanos;
    }

    /** Runs until a time, ns, or until it is interrupted. Sleep and flash operations are skipped. */
    runUntil(ns) {
        this.interrupted = false;
        while (this.ns < ns && !this.interrupted && !this.flash.lostPower) {
            const end = Math.min(ns - this.before, this.coming.length ? this.nextByte : Infinity);
            this.#runChip(end);
            if (this.triggered) this.#reset();
            else if (this.coming.length && this.chip.clock.nanos >= this.nextByte) this.#receive();
        }
    }

    /** Runs for a time. */
    run(ms) {
        this.runUntil(this.ns + ms * 1e6);
    }

    #runChip(end) {
        const { chip, rom } = this;
        const { core, clock } = chip;
        while (clock.nanos < end && !this.interrupted && !this.triggered) {
            if (core.waiting) {
                clock.tick(Math.min(Math.max(CLOCK_NS, clock.nanosToNextAlarm), end - clock.nanos));
            } else {
                const cycles = core.executeInstruction();
                this.instructions += 1;
                if (rom.waits) {
                    rom.waits = false;
                    const left = Math.min(rom.busyUntil, end) - clock.nanos;
                    clock.tick(Math.max(CLOCK_NS, Math.min(clock.nanosToNextAlarm || left, left)));
                    if (this.flash.lostPower) return;
                } else {
                    clock.tick(cycles * CLOCK_NS);
                }
            }
        }
    }

    #reset() {
        this.resets += 1;
        // A chip that starts drives no pin.
        this.levels.forEach((_, pin) => this.onPin(pin, GPIOPinState.Input));
        this.#start(this.chip);
    }

    #receive() {
        this.chip.uart[0].feedByte(this.coming.shift());
        this.nextByte += BYTE_NS;
    }

    #hear(line, bytes) {
        if (line === this.line) this.sent.push(...bytes);
        else this.unheard += bytes.length;
    }

    /** Queues bytes for the board. */
    send(bytes) {
        if (this.line === 'usb') {
            this.host.send(bytes);
            return;
        }
        if (!this.coming.length) this.nextByte = Math.max(this.nextByte, this.chip.clock.nanos + BYTE_NS);
        this.coming.push(...bytes);
    }

    /** Returns true if bytes for the board are still on their way. */
    get isSentTo() {
        return (this.line === 'usb' ? this.host.waiting : this.coming).length > 0;
    }

    /** Drops the bytes on their way to the board. */
    dropUnsent() {
        this.coming = [];
        if (this.host) this.host.waiting = [];
    }

    /** Sets the level of a pin. */
    put(pin, high) {
        if (this.levels[pin] === high) return;
        this.levels[pin] = high;
        this.chip.gpio[pin].setInputValue(high);
    }

    /** Sets the counts of a channel of the converter. With null the channel never gets ready. */
    convert(channel, counts) {
        this.counts[channel] = counts;
    }

    /** Switches the power off and on. Only the flash is kept, and memory has random contents. */
    powerUp() {
        this.flash.bytesLeft = Infinity;
        this.driverLine.drivers.forEach((driver) => driver.startAnew());
        this.levels.forEach((_, pin) => this.onPin(pin, GPIOPinState.Input));
        this.before = this.ns;
        this.#start();
        const { sram } = this.chip;
        for (let at = 0; at < sram.length; at++) sram[at] = Math.imul(at + this.before, 0x9e3779b1) >>> 24;
    }

    /** Makes the main loop run code at once, after an interrupt that may be running. */
    #derail(work) {
        const { core } = this.chip;
        while (core.IPSR !== 0) this.runUntil(this.ns + CLOCK_NS);
        core.waiting = false;
        work(core);
    }

    /** Makes the main loop hang, so that it no longer feeds the watchdog. */
    hang() {
        new DataView(this.chip.bootrom.buffer).setUint32(HANG_AT, HANG, true);
        this.#derail((core) => (core.PC = HANG_AT));
    }

    /** Makes the processor fault. */
    fault() {
        this.#derail((core) => core.exceptionEntry(HARD_FAULT));
    }

    /** Stops the crystal, so that the timer and the watchdog stand. The processor's clock continues, as its PLL may. */
    stopCrystal() {
        const timer = this.chip.peripherals[TIMER];
        const stands = new Map(TIMES.map((register) => [register, timer.readUint32(register)]));
        const read = timer.readUint32.bind(timer);
        timer.readUint32 = (register) => stands.get(register) ?? read(register);
        const watchdog = this.chip.peripherals[WATCHDOG];
        watchdog.timer.enable = false;
        watchdog.alarm.enable = false;
    }

    isHigh(pin) {
        return this.chip.gpio[pin].value === GPIOPinState.High;
    }

    isLow(pin) {
        return this.chip.gpio[pin].value === GPIOPinState.Low;
    }
}
