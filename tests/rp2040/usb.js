// The host's end of the board's USB. It detects the serial port like an operating system, checks the board's responses,
// opens the port and transfers bytes.
import assert from 'node:assert/strict';

/** Pause between the end of a transfer and the next one, ns. */
const PAUSE_NS = 50_000;
/** Time within which a request is refused, ns. */
const REFUSED_NS = 1_000_000;
const PACKET = 64;
const ADDRESS = 7;
/** Endpoint of bytes, in both directions (growbot-firmware/src/usb_serial.rs). */
const BYTES = 2;
const [DEVICE, CONFIGURATION, STRING, QUALIFIER] = [1, 2, 3, 6];
/** 9600 baud, 8N1. */
const CODING = [0x80, 0x25, 0, 0, 0, 0, 8];

/** Requests: kind, request, value, length, and either the check of the response or the bytes that are sent. */
const describe = (type, length, check, index = 0) => ({ setup: [0x80, 6, (type << 8) | index, length], check });
const REQUESTS = [
    describe(DEVICE, 64, (data) => assert.equal(data.length, 18)),
    { setup: [0x00, 5, ADDRESS, 0] },
    describe(DEVICE, 18, (data) => assert.deepEqual(data.slice(8, 12), [0x8a, 0x2e, 0x0a, 0x00])),
    { ...describe(QUALIFIER, 10), refused: true },
    describe(CONFIGURATION, 9, (data) => assert.deepEqual([data.length, data[2]], [9, 67])),
    describe(CONFIGURATION, 67, (data) => assert.equal(data.length, 67)),
    describe(STRING, 255, (data) => assert.deepEqual(data, [4, 3, 9, 4])),
    describe(STRING, 255, (data) => assert.equal(Buffer.from(data.slice(2)).toString('utf16le'), 'growbot'), 1),
    { setup: [0x00, 9, 1, 0] },
    { setup: [0x80, 8, 0, 1], check: (data) => assert.deepEqual(data, [1]) },
    { setup: [0x21, 0x20, 0, 7], bytes: CODING },
    { setup: [0xa1, 0x21, 0, 7], check: (data) => assert.deepEqual(data, CODING) },
    // This request opens the port.
    { setup: [0x21, 0x22, 3, 0] },
];

export class UsbHost {
    /** Connects a chip. `onBytes` gets bytes from the board, and bytes for the board wait until the port is open. */
    constructor(chip, onBytes) {
        this.usb = chip.usbCtrl;
        this.onBytes = onBytes;
        /** True if the port is open. */
        this.open = false;
        /** Bytes for the board, and true if the board takes a packet. */
        [this.waiting, this.takes] = [[], false];
        this.requests = [...REQUESTS];
        this.next = chip.clock.createAlarm(() => this.#begin());
        // The emulator reports a packet to the board some time before the packet comes.
        this.ending = chip.clock.createAlarm(() => this.#end());
        this.deadline = chip.clock.createAlarm(() => this.#expectRefused());
        this.usb.onUSBEnabled = () => this.usb.resetDevice();
        this.usb.onResetReceived = () => this.next.schedule(PAUSE_NS);
        this.usb.onEndpointWrite = (endpoint, bytes) => this.#take(endpoint, [...bytes]);
        this.usb.onEndpointRead = (endpoint, size) => this.#offer(endpoint, size);
    }

    send(bytes) {
        this.waiting.push(...bytes);
        this.#sendPacket();
    }

    #begin() {
        this.request = this.requests.shift();
        if (!this.request) {
            this.open = true;
            this.#sendPacket();
            return;
        }
        this.data = [];
        const [kind, request, value, length] = this.request.setup;
        const packet = Buffer.from([kind, request, 0, 0, 0, 0, 0, 0]);
        packet.writeUInt16LE(value, 2);
        packet.writeUInt16LE(length, 6);
        if (this.request.refused) {
            this.usb.epStallArm = 0;
            this.deadline.schedule(REFUSED_NS);
        }
        this.usb.sendSetupPacket(packet);
    }

    #expectRefused() {
        assert.equal(this.usb.epStallArm, 3, `USB: a request was not refused: ${this.request.setup}`);
        this.#begin();
    }

    #end() {
        this.request.check?.(this.data);
        const addressed = this.requests.length < REQUESTS.length - 1;
        assert.equal(this.usb.addrEndp, addressed ? ADDRESS : 0, 'USB: the board has another address');
        this.next.schedule(PAUSE_NS);
    }

    #take(endpoint, bytes) {
        if (endpoint === BYTES) {
            assert(bytes.length < PACKET, 'USB: a full packet, after which a host waits for more');
            this.onBytes(bytes);
            return;
        }
        const toHost = (this.request.setup[0] & 0x80) !== 0;
        assert(toHost || bytes.length === 0, `USB: ${bytes} instead of nothing`);
        this.data.push(...bytes);
        if (!toHost) this.#end();
    }

    /** Handles that the board takes a packet. */
    #offer(endpoint, size) {
        if (endpoint === BYTES) {
            assert.equal(size, PACKET);
            this.takes = true;
            this.#sendPacket();
        } else if (this.request.bytes) {
            this.usb.endpointReadDone(0, Uint8Array.from(this.request.bytes));
        } else {
            // The status stage of a request after its response has come.
            this.usb.endpointReadDone(0, new Uint8Array(0));
            this.ending.schedule(PAUSE_NS);
        }
    }

    #sendPacket() {
        if (!this.open || !this.takes || this.waiting.length === 0) return;
        this.takes = false;
        this.usb.endpointReadDone(BYTES, Uint8Array.from(this.waiting.splice(0, PACKET)));
    }
}
