// The flash chip of a Pico, a W25Q16JV: its cells, the duration of changes, and losses of power during them.

/** Bytes of the chip, and of the parts that are programmed or erased at once. */
export const BYTES = 2 * 1024 * 1024;
export const PAGE = 256;
export const SECTOR = 4096;
/** Commands that erase, with the number of bytes and the duration, ns: typical values of the data sheet (9.6). */
const ERASE = { 0x20: [SECTOR, 45e6], 0x52: [32768, 120e6], 0xd8: [65536, 150e6] };
export const ERASE_SECTOR = 0x20;
const PROGRAM_PAGE_NS = 0.4e6;

/** Returns the bits of a byte at which power was lost. They depend on the address and are the same in every run. */
const noise = (at) => (Math.imul(at + 1, 0x9e3779b1) >>> 13) & 0xff;

export class Flash {
    constructor(cells) {
        this.cells = cells;
        /** Number of bytes that can be changed before power is lost. */
        this.bytesLeft = Infinity;
        /** Bytes programmed and erased so far. */
        this.changed = 0;
        /** Ratio of the duration of operations to the typical one. */
        this.slowness = 1;
    }

    get lostPower() {
        return this.bytesLeft <= 0;
    }

    /** Returns how many of these bytes are changed before power is lost. */
    #spend(bytes) {
        const spent = Math.min(bytes, this.bytesLeft);
        this.bytesLeft -= spent;
        this.changed += spent;
        return spent;
    }

    /** Clears the bits of a page that are zero in these bytes. Returns the duration, ns. */
    program(offset, bytes) {
        const whole = this.#spend(bytes.length);
        for (let at = 0; at < whole; at++) this.cells[offset + at] &= bytes[at];
        // The byte at which power is lost has only some of its bits cleared.
        if (whole < bytes.length) this.cells[offset + whole] &= bytes[whole] | noise(offset + whole);
        return PROGRAM_PAGE_NS * this.slowness * (whole / bytes.length);
    }

    /** Erases by a command. Returns the number of bytes, and the duration, ns. */
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
