// The flash chip of a Pico, a W25Q16JV: cells, how long it takes to change them, and losses of power in between.

/** Bytes of the chip, and of what is programmed or erased at once. */
export const BYTES = 2 * 1024 * 1024;
export const PAGE = 256;
export const SECTOR = 4096;
/** Commands that erase: how many bytes, and how long, ns: typical values of the data sheet (9.6). */
const ERASE = { 0x20: [SECTOR, 45e6], 0x52: [32768, 120e6], 0xd8: [65536, 150e6] };
export const ERASE_SECTOR = 0x20;
const PROGRAM_PAGE_NS = 0.4e6;

/** Bits of a byte that power was lost over: the same at every run, others at every place. */
const noise = (at) => (Math.imul(at + 1, 0x9e3779b1) >>> 13) & 0xff;

export class Flash {
    constructor(cells) {
        this.cells = cells;
        /** How many more bytes are changed until the power is lost. */
        this.bytesLeft = Infinity;
        /** Bytes programmed and erased so far. */
        this.changed = 0;
        /** How many times as long as typical everything takes. */
        this.slowness = 1;
    }

    get lostPower() {
        return this.bytesLeft <= 0;
    }

    /** How many of these bytes are changed before the power is lost. */
    #spend(bytes) {
        const spent = Math.min(bytes, this.bytesLeft);
        this.bytesLeft -= spent;
        this.changed += spent;
        return spent;
    }

    /** Clears the bits of a page that are zero in these bytes. Gives the time that it takes, ns. */
    program(offset, bytes) {
        const whole = this.#spend(bytes.length);
        for (let at = 0; at < whole; at++) this.cells[offset + at] &= bytes[at];
        // The byte that the loss of power meets has some of its bits.
        if (whole < bytes.length) this.cells[offset + whole] &= bytes[whole] | noise(offset + whole);
        return PROGRAM_PAGE_NS * this.slowness * (whole / bytes.length);
    }

    /** Erases by a command. Gives the bytes erased, and the time that it takes, ns. */
    erase(offset, command) {
        const [bytes, ns] = ERASE[command] ?? [];
        if (!bytes) throw new Error(`the flash has no command 0x${command.toString(16)} that erases`);
        const from = offset - (offset % bytes);
        const whole = this.#spend(bytes);
        this.cells.fill(0xff, from, from + whole);
        const half = Math.min(PAGE, bytes - whole);
        for (let at = from + whole; at < from + whole + half; at++) this.cells[at] |= noise(at);
        return [bytes, ns * this.slowness * (whole / bytes)];
    }
}
