// A Pico in rp2040js: the ELF image as the linker made it, in virtual time. There is no boot ROM: the image starts at
// its vector table, behind the second-stage loader, and the ROM has no table of functions.
import { readFileSync } from 'node:fs';
import { GPIOPinState, LogLevel, RP2040, ConsoleLogger } from 'rp2040js';

const FLASH = 0x10000000;
const VECTORS = FLASH + 0x100;
/** ns of a clock at 125 MHz. */
const CLOCK_NS = 8;

/** The loaded segments of a 32-bit ELF image: address and bytes. */
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

export class Board {
    constructor(image) {
        this.chip = new RP2040();
        this.chip.logger = new ConsoleLogger(LogLevel.Error, true);
        for (const [address, bytes] of segments(readFileSync(image))) {
            this.chip.flash.set(bytes, address - FLASH);
        }
        /** Bytes that the board has sent. */
        this.sent = [];
        this.chip.uart[0].onByte = (byte) => this.sent.push(byte);
        /** Resets by the watchdog. */
        this.resets = 0;
        this.chip.peripherals[0x40058].onWatchdogTrigger = () => (this.resets += 1);
        const { core } = this.chip;
        core.VTOR = VECTORS;
        core.SP = this.chip.readUint32(VECTORS);
        core.PC = this.chip.readUint32(VECTORS + 4) & ~1;
    }

    get ns() {
        return this.chip.clock.nanos;
    }

    /** Runs for a time; sleep is skipped. */
    run(ms) {
        const { chip } = this;
        const end = this.ns + ms * 1e6;
        while (this.ns < end) {
            if (chip.core.waiting) {
                chip.clock.tick(Math.max(CLOCK_NS, chip.clock.nanosToNextAlarm));
            } else {
                chip.clock.tick(chip.core.executeInstruction() * CLOCK_NS);
            }
        }
    }

    /** Sends bytes to the board, at 115200 baud. */
    send(bytes) {
        for (const byte of bytes) {
            this.chip.uart[0].feedByte(byte);
            this.run(10 / 115.2);
        }
    }

    isHigh(pin) {
        return this.chip.gpio[pin].value === GPIOPinState.High;
    }

    isLow(pin) {
        return this.chip.gpio[pin].value === GPIOPinState.Low;
    }
}
