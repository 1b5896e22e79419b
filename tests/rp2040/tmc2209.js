// Four TMC2209 stepper drivers on one wire at UART1, addresses 0 to 3: their registers, their counters of writes, and
// responses at the line's rate (data sheet, rev. 1.09, 4.1). The board receives an echo of its own bytes.
//
// The motors are not modelled. A test sets the driver's measurements in `registers`.

/** Duration of a byte at 115200 baud, and of the pause of 3 times 8 bits before a response, ns. */
const BYTE_NS = 1e10 / 115200;
const PAUSE_NS = (24 * 1e9) / 115200;
const [SYNC, TO_THE_BOARD, WRITE] = [0x05, 0xff, 0x80];
export const REGISTERS = {
    GCONF: 0x00,
    GSTAT: 0x01,
    IFCNT: 0x02,
    IHOLD_IRUN: 0x10,
    TSTEP: 0x12,
    TCOOLTHRS: 0x14,
    SGTHRS: 0x40,
    SG_RESULT: 0x41,
    CHOPCONF: 0x6c,
    DRV_STATUS: 0x6f,
};
const { GSTAT, IFCNT, TSTEP, SG_RESULT, DRV_STATUS } = REGISTERS;
/** DRV_STATUS of a motor that stands still, and of one that turns, both in StealthChop. */
export const STANDS = 0xc0000000;
export const TURNS = 0x40000000;

/** Returns the CRC of a datagram. */
function crc(bytes) {
    let value = 0;
    for (let byte of bytes) {
        for (let bit = 0; bit < 8; bit++, byte >>= 1) {
            value = (value >> 7) ^ (byte & 1) ? (value << 1) ^ 0x07 : value << 1;
            value &= 0xff;
        }
    }
    return value;
}

class Driver {
    constructor() {
        /** True if the driver does not respond and takes no writes. */
        this.silent = false;
        this.startAnew();
    }

    /** Resets the driver, as when its supply comes on. */
    startAnew() {
        this.registers = new Map([
            [GSTAT, 1],
            [IFCNT, 0],
            [TSTEP, 0xfffff],
            [SG_RESULT, 400],
            [DRV_STATUS, STANDS],
        ]);
    }

    write(register, value) {
        if (this.silent) return;
        this.registers.set(IFCNT, (this.registers.get(IFCNT) + 1) % 256);
        // Ones clear the flags of GSTAT.
        this.registers.set(register, register === GSTAT ? this.registers.get(GSTAT) & ~value : value);
    }

    answer(register) {
        if (this.silent) return [];
        const value = this.registers.get(register) ?? 0;
        const bytes = [SYNC, TO_THE_BOARD, register, ...[24, 16, 8, 0].map((bits) => (value >>> bits) & 0xff)];
        return [...bytes, crc(bytes)];
    }
}

export class DriverLine {
    constructor() {
        this.drivers = [0, 1, 2, 3].map(() => new Driver());
    }

    /** Connects the line to a chip that has just started. The drivers keep their state. */
    join({ clock, uart }) {
        const line = uart[1];
        const coming = [];
        let datagram = [];
        let free = 0;
        const alarm = clock.createAlarm(() => {
            while (coming.length && coming[0].at <= clock.nanos) line.feedByte(coming.shift().byte);
            if (coming.length) alarm.schedule(coming[0].at - clock.nanos);
        });
        const put = (byte) => {
            free = Math.max(free, clock.nanos) + BYTE_NS;
            coming.push({ byte, at: free });
            if (coming.length === 1) alarm.schedule(free - clock.nanos);
        };
        line.onByte = (byte) => {
            put(byte);
            datagram.push(byte);
            const [sync, node, register] = datagram;
            if (sync !== SYNC) datagram = [];
            if (datagram.length < 3 || datagram.length < (register & WRITE ? 8 : 4)) return;
            const [bytes, check] = [datagram.slice(0, -1), datagram.at(-1)];
            datagram = [];
            const driver = this.drivers[node];
            if (check !== crc(bytes) || !driver) return;
            if (register & WRITE) {
                driver.write(register & ~WRITE, bytes.slice(3).reduce((value, byte) => value * 256 + byte, 0));
            } else {
                free += PAUSE_NS;
                driver.answer(register).forEach(put);
            }
        };
    }
}
