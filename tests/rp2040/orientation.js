// The orientation sensor, a BMI160 at address 0x68: only its I2C interface and its acceleration (data sheet, 2.11 and
// 3.2.1). Both lines are high unless one side pulls them low.

const ADDRESS = 0x68;
const [CHIP_ID, PMU_STATUS, ACCELERATION, RANGE, COMMAND] = [0x00, 0x03, 0x12, 0x41, 0x7e];
const ACCELERATION_ON = 0x11;
/** Counts per 1/1000 g at a range of 2 g. */
const COUNTS = 16.384;

export class Orientation {
    constructor() {
        this.registers = new Uint8Array(256);
        [this.registers[CHIP_ID], this.registers[RANGE]] = [0xd1, 0x03];
        /** Gravity along the axes, 1/1000 g. It is null if no sensor responds. */
        this.gravity = null;
        /** True while the sensor pulls the data line low. */
        this.holdsData = false;
        this.register = 0;
        /** Previous levels of the lines. */
        [this.clock, this.data] = [true, true];
        /** Phase: idle, receives `what`, acknowledges it, sends, or waits for an acknowledgement. */
        this.phase = 'idle';
    }

    #take(what) {
        [this.phase, this.what, this.byte, this.bits] = ['take', what, 0, 0];
    }

    #send() {
        [this.phase, this.byte, this.bits] = ['send', this.registers[this.register], 0];
        this.register = (this.register + 1) & 0xff;
        this.#sendBit();
    }

    #sendBit() {
        this.holdsData = (this.byte & (0x80 >> this.bits)) === 0;
        this.bits += 1;
    }

    /** Latches a reading, so that all its bytes are from one time. */
    #measure() {
        const view = new DataView(this.registers.buffer);
        this.gravity?.forEach((milliG, axis) => {
            const counts = Math.max(-32768, Math.min(32767, Math.round(milliG * COUNTS)));
            view.setInt16(ACCELERATION + 2 * axis, counts, true);
        });
    }

    /** Handles a received byte. Returns what comes after it, or null if it is not acknowledged. */
    #taken() {
        const { what, byte } = this;
        if (what === 'address') {
            if (byte >> 1 !== ADDRESS || this.gravity === null) return null;
            if ((byte & 1) === 0) return 'register';
            this.#measure();
            return 'send';
        }
        if (what === 'register') {
            this.register = byte;
            return 'value';
        }
        this.registers[this.register] = byte;
        if (this.register === COMMAND && byte === ACCELERATION_ON) this.registers[PMU_STATUS] = 0x10;
        this.register = (this.register + 1) & 0xff;
        return 'value';
    }

    #fall() {
        if (this.phase === 'take' && this.bits === 8) {
            this.next = this.#taken();
            this.phase = this.next ? 'acknowledge' : 'idle';
            this.holdsData = this.next !== null;
        } else if (this.phase === 'acknowledge') {
            this.holdsData = false;
            if (this.next === 'send') this.#send();
            else this.#take(this.next);
        } else if (this.phase === 'send') {
            if (this.bits < 8) this.#sendBit();
            else [this.phase, this.holdsData] = ['listen', false];
        } else if (this.phase === 'listen') {
            if (this.wanted) this.#send();
            else this.phase = 'idle';
        }
    }

    #rise(data) {
        if (this.phase === 'take') [this.byte, this.bits] = [(this.byte << 1) | (data ? 1 : 0), this.bits + 1];
        if (this.phase === 'listen') this.wanted = !data;
    }

    /** Handles new levels of the lines from the board. True means that the board does not pull a line low. */
    see(clock, boardsData) {
        const data = boardsData && !this.holdsData;
        if (this.clock && clock && data !== this.data) {
            if (data) [this.phase, this.holdsData] = ['idle', false];
            else this.#take('address');
        } else if (clock && !this.clock) {
            this.#rise(data);
        } else if (!clock && this.clock) {
            this.#fall();
        }
        this.clock = clock;
        this.data = boardsData && !this.holdsData;
    }
}
