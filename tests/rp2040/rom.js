// The part of the boot ROM that the firmware uses (data sheet of the RP2040, 2.8.3): a table of functions at 0x14, a
// function at 0x18 that searches it, and the functions that change flash. Each function is a breakpoint at which
// JavaScript does the work. Interrupts are taken while the flash is busy.
//
// From `connect_internal_flash` until the second-stage loader has set up the flash's interface again, nothing can be
// read from flash. Such a read ends the emulation with an error that names the reader.
import { BYTES, ERASE_SECTOR, PAGE, SECTOR } from './flash.js';

const TABLE = 0x100;
const CODE = 0x200;
const BREAKPOINT = 0xbe00;
const RETURN = 0x4770;
/** Offsets of the flash's interface, its control and its switch, and the control value that the loader ends with. */
const [SSI_CONTROL, SSI_ENABLE] = [0x00, 0x08];
const EXECUTE_IN_PLACE = 0x005f0300;

const code = (name) => name.charCodeAt(0) | (name.charCodeAt(1) << 8);

export class Rom {
    /** Adds a ROM to a chip that has this flash. */
    constructor(chip, flash) {
        Object.assign(this, { chip, flash });
        /** Time until which the flash is busy, ns. It is null while the flash is idle. */
        this.busyUntil = null;
        /** True while the processor waits for the flash. */
        this.waits = false;
        /** Called when the flash begins to `erase` or to `program`, with begin and end, ns of the chip. */
        this.onWork = () => {};
        /** True if the flash has been connected, and if its execution in place has ended. */
        [this.connected, this.exited] = [false, false];
        this.mapped = { flash: chip.flash, flashView: chip.flashView };
        this.functions = [
            ['', this.#search],
            ['IF', this.#connect],
            ['EX', this.#exit],
            ['RE', this.#erase],
            ['RP', this.#program],
            ['FC', this.#flush],
            ['CX', this.#enter],
        ];
        const rom = new DataView(chip.bootrom.buffer);
        rom.setUint16(0x14, TABLE, true);
        rom.setUint16(0x18, CODE + 1, true);
        this.functions.forEach(([name], index) => {
            const address = CODE + 4 * index;
            rom.setUint16(address, BREAKPOINT | index, true);
            rom.setUint16(address + 2, RETURN, true);
            if (index > 0) {
                rom.setUint16(TABLE + 4 * (index - 1), code(name), true);
                rom.setUint16(TABLE + 4 * (index - 1) + 2, address + 1, true);
            }
        });
        chip.onBreak = (index) => this.#call(index);
        this.#watchInterface();
    }

    #call(index) {
        const { core } = this.chip;
        const address = CODE + 4 * index;
        const [, work] = this.functions[index] ?? [];
        if (!work || core.PC !== address + 2) throw new Error(`a breakpoint at 0x${(core.PC - 2).toString(16)}`);
        if (this.busyUntil === null) work.call(this, core.registers);
        if (this.busyUntil === null) return;
        if (this.chip.clock.nanos < this.busyUntil) [core.PC, this.waits] = [address, true];
        else this.busyUntil = null;
    }

    #search(registers) {
        const [table, wanted] = registers;
        for (let at = table; ; at += 4) {
            const name = this.chip.readUint16(at);
            if (name === 0 || name === wanted) {
                registers[0] = name && this.chip.readUint16(at + 2);
                return;
            }
        }
    }

    #connect() {
        this.connected = true;
        this.#unmap();
    }

    #exit() {
        if (!this.connected) throw new Error('flash_exit_xip without connect_internal_flash');
        this.exited = true;
    }

    #check(what, offset, bytes, unit) {
        if (!this.exited) throw new Error(`${what} without flash_exit_xip`);
        if (offset % unit || bytes % unit || offset + bytes > BYTES) {
            throw new Error(`${what} of ${bytes} bytes at ${offset}: not whole pieces of ${unit} within the chip`);
        }
    }

    /** The whole range is one wait. */
    #erase([offset, bytes, block, command]) {
        this.#check('flash_range_erase', offset, bytes, SECTOR);
        let ns = 0;
        for (let at = offset; at < offset + bytes && !this.flash.lostPower; ) {
            const whole = at % block === 0 && at + block <= offset + bytes;
            const [erased, time] = this.flash.erase(at, whole ? command : ERASE_SECTOR);
            if (whole && erased !== block) throw new Error(`command ${command} erases ${erased} bytes, not ${block}`);
            at += erased;
            ns += time;
        }
        this.#work('erase', ns);
    }

    #program([offset, data, bytes]) {
        this.#check('flash_range_program', offset, bytes, PAGE);
        let ns = 0;
        for (let at = 0; at < bytes && !this.flash.lostPower; at += PAGE) {
            const page = Uint8Array.from({ length: PAGE }, (_, index) => this.chip.readUint8(data + at + index));
            ns += this.flash.program(offset + at, page);
        }
        this.#work('program', ns);
    }

    #work(what, ns) {
        const { nanos } = this.chip.clock;
        this.busyUntil = nanos + ns;
        this.onWork(what, nanos, this.busyUntil);
    }

    #flush() {
        if (!this.exited) throw new Error('flash_flush_cache without flash_exit_xip');
    }

    #enter() {
        this.#map();
    }

    /** Detects that the loader sets up the interface. */
    #watchInterface() {
        const ssi = this.chip.peripherals[0x18000];
        const write = ssi.writeUint32.bind(ssi);
        ssi.writeUint32 = (offset, value) => {
            write(offset, value);
            const control = ssi.readUint32(SSI_CONTROL);
            if (offset === SSI_ENABLE && value === 1 && control === EXECUTE_IN_PLACE) this.#map();
        };
    }

    #unmap() {
        this.chip.flash = new Uint8Array(0);
        this.chip.flashView = new DataView(new ArrayBuffer(0));
    }

    #map() {
        [this.connected, this.exited] = [false, false];
        Object.assign(this.chip, this.mapped);
    }
}
