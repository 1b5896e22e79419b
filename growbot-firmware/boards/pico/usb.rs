//! The link over USB: a serial port that works entirely in the interrupt of the USB controller (data sheet of the
//! RP2040, 4.1).
//!
//! The interrupt runs from RAM, like that of the UART, so that an emergency stop is carried out while the flash is
//! written to. Both interrupts have the same priority, because either may receive an emergency stop.

use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_firmware::usb_serial::{
    ControlResponse, DATA_ENDPOINT, MAX_PACKET_BYTES, NOTIFICATION_ENDPOINT, Setup, UsbContent, UsbSerial,
};
use rp2040_pac as pac;
use rp2040_pac::interrupt;

use crate::interrupt_cell::InterruptCell;
use crate::uart::{self, LinkQueue};

/// Bytes that the host has sent over USB, oldest first.
pub static RECEIVED: LinkQueue = LinkQueue::new();
/// Bytes to send to the host over USB, oldest first. Call [`send_queued`] after adding some. The bytes wait while the
/// host accepts none, and are dropped when the host opens or closes the port.
pub static TO_SEND: LinkQueue = LinkQueue::new();

/// Bit of the USB controller in the reset register.
const RESET: u32 = 1 << 24;
/// Address of the USB controller's memory. It contains the setup packet at offset 0. The next constants are the offsets
/// of the endpoint controls, the buffer controls, and the buffers.
const MEMORY: usize = 0x5010_0000;
const ENDPOINTS: usize = 0x08;
const BUFFERS: usize = 0x80;
const CONTROL_BUFFER: usize = 0x100;
const NOTIFICATION_BUFFER: usize = 0x180;
const RECEIVE_BUFFER: usize = 0x1C0;
const SEND_BUFFER: usize = 0x200;
/// Bits of an endpoint control: in use, with an interrupt for each buffer. `BULK` and `INTERRUPT` are kinds of
/// endpoints.
const ENDPOINT_ON: u32 = 1 << 31 | 1 << 29;
const BULK: u32 = 2 << 26;
const INTERRUPT: u32 = 3 << 26;
/// Bit of a buffer control: the buffer is full. The next constants are the other bits, and the mask of the length.
const FULL: u32 = 1 << 15;
const ODD: u32 = 1 << 13;
const STALL: u32 = 1 << 11;
const AVAILABLE: u32 = 1 << 10;
const LENGTH: u32 = 0x3FF;
/// Interrupt bit: a buffer was sent or received. The next constants are the bits of a bus reset and of a setup packet.
const ON_BUFFER: u32 = 1 << 4;
const ON_BUS_RESET: u32 = 1 << 12;
const ON_SETUP: u32 = 1 << 16;
/// Flag of a bus reset, which causes an interrupt. `SETUP_RECEIVED` is that of a setup packet.
const BUS_RESET: u32 = 1 << 19;
const SETUP_RECEIVED: u32 = 1 << 17;
/// Bit of the pull-up of the bus, which shows the device to the host. `CONTROL_INTERRUPT` enables an interrupt for each
/// buffer of endpoint 0.
const PULL_UP: u32 = 1 << 16;
const CONTROL_INTERRUPT: u32 = 1 << 29;

static DEVICE: InterruptCell<Device> = InterruptCell::empty();

/// State of the control transfer on endpoint 0.
#[derive(Clone, Copy)]
enum Control {
    Idle,
    /// The device sends a content. The numbers are the index of the next byte, and the index after the last byte.
    SendingData(UsbContent, usize, usize),
    ReceivingLineCoding,
    /// The device takes this address once the host has received the empty reply.
    SettingAddress(u8),
}

/// The buffer of an endpoint in one direction.
#[derive(Clone, Copy)]
struct Buffer {
    /// Offset of the buffer's control word in the controller's memory.
    control: usize,
    at: usize,
    /// True if the next packet is an odd one (DATA1).
    data1: bool,
}

struct Device {
    serial: UsbSerial,
    watch: EmergencyStopDetector,
    control: Control,
    reply: Buffer,
    request: Buffer,
    receive: Buffer,
    send: Buffer,
    /// True while a packet waits for the host to accept it.
    sends: bool,
}

fn registers() -> &'static pac::usbctrl_regs::RegisterBlock {
    // SAFETY: `start` uses it before the interrupt is enabled. After that only the interrupt does. Other code forces
    // the interrupt by a separate register.
    unsafe { &*pac::USBCTRL_REGS::ptr() }
}

fn memory(offset: usize) -> *mut u32 {
    (MEMORY + offset) as *mut u32
}

fn write(offset: usize, word: u32) {
    // SAFETY: the controller's memory, of which Rust code owns nothing.
    unsafe { memory(offset).write_volatile(word) };
}

fn read(offset: usize) -> u32 {
    // SAFETY: as above.
    unsafe { memory(offset).read_volatile() }
}

impl Buffer {
    const fn new(endpoint: u8, from_host: bool, at: usize) -> Self {
        let control = BUFFERS + 8 * endpoint as usize + 4 * from_host as usize;
        Self { control, at, data1: false }
    }

    /// Hands the buffer over to the controller, which then sends it or receives into it.
    fn hand_over(&mut self, flags: u32) {
        let odd = if self.data1 { ODD } else { 0 };
        self.data1 = !self.data1;
        write(self.control, flags | odd);
        // The controller, with its clock of 48 MHz, must see the other bits before this one.
        // SAFETY: the instructions only take time.
        unsafe { core::arch::asm!("nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop") };
        write(self.control, flags | odd | AVAILABLE);
    }

    /// Writes the bytes of a packet to the buffer and lets the controller send it.
    fn send(&mut self, bytes: impl Iterator<Item = u8>) {
        let (mut count, mut word) = (0, 0);
        for byte in bytes.take(MAX_PACKET_BYTES) {
            word |= u32::from(byte) << (8 * (count % 4));
            count += 1;
            if count % 4 == 0 {
                write(self.at + count - 4, word);
                word = 0;
            }
        }
        if count % 4 != 0 {
            write(self.at + count / 4 * 4, word);
        }
        self.hand_over(FULL | count as u32);
    }

    /// Returns the bytes of the packet that was received in the buffer.
    fn received(self) -> impl Iterator<Item = u8> {
        let count = (read(self.control) & LENGTH) as usize;
        (0..count.min(MAX_PACKET_BYTES)).map(move |at| (read(self.at + at / 4 * 4) >> (8 * (at % 4))) as u8)
    }
}

impl Device {
    const fn new() -> Self {
        Self {
            serial: UsbSerial::new(),
            watch: EmergencyStopDetector::new(),
            control: Control::Idle,
            reply: Buffer::new(0, false, CONTROL_BUFFER),
            request: Buffer::new(0, true, CONTROL_BUFFER),
            receive: Buffer::new(DATA_ENDPOINT, true, RECEIVE_BUFFER),
            send: Buffer::new(DATA_ENDPOINT, false, SEND_BUFFER),
            sends: false,
        }
    }

    fn on_bus_reset(&mut self) {
        self.serial.reset();
        self.control = Control::Idle;
        self.configure(false);
        // SAFETY: the address of a device that has none yet, and a flag that is cleared.
        unsafe {
            registers().addr_endp().write(|w| w.bits(0));
            registers().sie_status().write(|w| w.bits(BUS_RESET));
        }
    }

    /// Enables or disables the endpoints of notifications and data bytes, and drops the queued bytes.
    fn configure(&mut self, on: bool) {
        for buffer in [&mut self.receive, &mut self.send] {
            write(buffer.control, 0);
            buffer.data1 = false;
        }
        self.sends = false;
        drop_queued();
        let on_if = |kind: u32, at: usize| if on { ENDPOINT_ON | kind | at as u32 } else { 0 };
        write(ENDPOINTS + 8 * (usize::from(NOTIFICATION_ENDPOINT) - 1), on_if(INTERRUPT, NOTIFICATION_BUFFER));
        write(ENDPOINTS + 8 * (usize::from(DATA_ENDPOINT) - 1), on_if(BULK, SEND_BUFFER));
        write(ENDPOINTS + 8 * (usize::from(DATA_ENDPOINT) - 1) + 4, on_if(BULK, RECEIVE_BUFFER));
        if on {
            self.receive.hand_over(MAX_PACKET_BYTES as u32);
        }
    }

    fn on_setup(&mut self) {
        // SAFETY: a flag that is cleared.
        unsafe { registers().sie_status().write(|w| w.bits(SETUP_RECEIVED)) };
        write(self.reply.control, 0);
        write(self.request.control, 0);
        // The first packet after a request is an odd one.
        (self.reply.data1, self.request.data1, self.control) = (true, true, Control::Idle);
        match self.serial.answer(Setup::new(read(0), read(4))) {
            ControlResponse::Send(content, most) => {
                let length = self.serial.content(content).len();
                self.control = Control::SendingData(content, 0, length.min(most));
                self.send_reply();
                return;
            }
            ControlResponse::TakeCoding => {
                self.control = Control::ReceivingLineCoding;
                self.request.hand_over(MAX_PACKET_BYTES as u32);
                return;
            }
            ControlResponse::Refuse => {
                // SAFETY: both directions of endpoint 0.
                unsafe { registers().ep_stall_arm().write(|w| w.bits(0b11)) };
                write(self.reply.control, STALL);
                write(self.request.control, STALL);
                return;
            }
            ControlResponse::Address(address) => self.control = Control::SettingAddress(address),
            ControlResponse::Configure(on) => self.configure(on),
            ControlResponse::ClearEndpoint(endpoint) => self.clear(endpoint),
            ControlResponse::Opened => drop_queued(),
            ControlResponse::Done => {}
        }
        self.reply.send(core::iter::empty());
    }

    /// Resets the packet sequence of an endpoint (DATA0 is next), as the host requests.
    fn clear(&mut self, endpoint: u8) {
        if !self.serial.is_configured() {
        } else if endpoint == DATA_ENDPOINT {
            self.receive.data1 = false;
            self.receive.hand_over(MAX_PACKET_BYTES as u32);
        } else if endpoint == 0x80 | DATA_ENDPOINT {
            write(self.send.control, 0);
            (self.send.data1, self.sends) = (false, false);
        }
    }

    /// Sends the next packet of a reply. After the last packet of the reply, the host sends an empty packet.
    fn send_reply(&mut self) {
        let Control::SendingData(content, from, until) = self.control else { return };
        let to = until.min(from + MAX_PACKET_BYTES);
        self.control = Control::SendingData(content, to, until);
        let bytes = self.serial.content(content).iter().copied();
        self.reply.send(bytes.skip(from).take(to - from));
    }

    fn on_reply_sent(&mut self) {
        match self.control {
            Control::SendingData(_, from, until) if from < until => self.send_reply(),
            Control::SendingData(..) => {
                self.control = Control::Idle;
                self.request.data1 = true;
                self.request.hand_over(0);
            }
            Control::SettingAddress(address) => {
                self.control = Control::Idle;
                // SAFETY: an address of 7 bits.
                unsafe { registers().addr_endp().write(|w| w.bits(u32::from(address))) };
            }
            Control::Idle | Control::ReceivingLineCoding => {}
        }
    }

    fn on_request(&mut self) {
        if let Control::ReceivingLineCoding = self.control {
            self.control = Control::Idle;
            self.serial.take_coding(self.request.received());
            self.reply.send(core::iter::empty());
        }
    }

    fn on_received(&mut self) {
        for byte in self.receive.received() {
            uart::check_for_emergency_stop(&mut self.watch, byte);
            // A byte is lost if the queue is full, which the CRC of its frame shows.
            let _ = RECEIVED.enqueue(byte);
        }
        if self.serial.is_configured() {
            self.receive.hand_over(MAX_PACKET_BYTES as u32);
        }
    }

    /// Sends queued bytes to the host if no packet waits. The packets are never full, because a host waits for more
    /// after a full packet.
    fn send_bytes(&mut self) {
        if self.sends || !self.serial.is_configured() || TO_SEND.is_empty() {
            return;
        }
        self.sends = true;
        self.send.send(core::iter::from_fn(|| TO_SEND.dequeue()).take(MAX_PACKET_BYTES - 1));
    }

    fn on_buffers(&mut self) {
        let done = registers().buff_status().read().bits();
        // SAFETY: flags that are cleared.
        unsafe { registers().buff_status().write(|w| w.bits(done)) };
        let is_done = |endpoint: u8, from_host: bool| done & 1 << (2 * endpoint + u8::from(from_host)) != 0;
        if is_done(0, false) {
            self.on_reply_sent();
        }
        if is_done(0, true) {
            self.on_request();
        }
        if is_done(DATA_ENDPOINT, true) {
            self.on_received();
        }
        if is_done(DATA_ENDPOINT, false) {
            self.sends = false;
        }
    }
}

/// Drops the queued bytes that the host has not accepted. They are for a program that has closed the port.
fn drop_queued() {
    while TO_SEND.dequeue().is_some() {}
}

/// Starts to send the queued bytes: forces the interrupt, which reads the queue.
pub fn send_queued() {
    // SAFETY: an interrupt that its handler clears.
    unsafe { registers().intf().write(|w| w.bits(ON_BUFFER)) };
}

/// Initialises the USB controller. The host detects a device, which responds once the interrupts are enabled.
pub fn start(resets: &pac::RESETS) {
    let usb = registers();
    // SAFETY: values of the data sheet. The reset shows the host that the board has restarted.
    unsafe {
        resets.reset().modify(|r, w| w.bits(r.bits() | RESET));
        resets.reset().modify(|r, w| w.bits(r.bits() & !RESET));
        while resets.reset_done().read().bits() & RESET == 0 {}
    }
    (0..CONTROL_BUFFER).step_by(4).for_each(|offset| write(offset, 0));
    DEVICE.init(Device::new());
    // SAFETY: values of the data sheet. The bus counts as supplied, because not every board has a pin that detects it.
    unsafe {
        usb.usb_muxing().write(|w| w.bits(1 | 1 << 3));
        usb.usb_pwr().write(|w| w.bits(1 << 3 | 1 << 2));
        usb.main_ctrl().write(|w| w.bits(1));
        usb.sie_ctrl().write(|w| w.bits(CONTROL_INTERRUPT));
        usb.inte().write(|w| w.bits(ON_BUFFER | ON_BUS_RESET | ON_SETUP));
        usb.sie_ctrl().write(|w| w.bits(CONTROL_INTERRUPT | PULL_UP));
    }
}

#[interrupt]
fn USBCTRL_IRQ() {
    let pending = registers().ints().read().bits();
    // SAFETY: the work for which the interrupt was forced is done below.
    unsafe { registers().intf().write(|w| w.bits(0)) };
    // SAFETY: only this interrupt calls this.
    unsafe {
        DEVICE.with(|device| {
            if pending & ON_BUS_RESET != 0 {
                device.on_bus_reset();
            }
            if pending & ON_BUFFER != 0 {
                device.on_buffers();
            }
            if pending & ON_SETUP != 0 {
                device.on_setup();
            }
            device.send_bytes();
        });
    }
}
