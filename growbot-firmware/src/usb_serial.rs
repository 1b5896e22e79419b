//! The control requests of a USB serial port (class CDC, abstract control model), for any chip.
//!
//! All content that is sent to the host is stored in [`UsbSerial`], and so in RAM. Requests therefore get a response
//! even while the flash cannot be read.

/// Max length of a packet on every endpoint, bytes.
pub const MAX_PACKET_BYTES: usize = 64;
/// Number of the endpoint for notifications. The device never sends a notification.
pub const NOTIFICATION_ENDPOINT: u8 = 1;
/// Number of the endpoint for the data bytes, in each direction.
pub const DATA_ENDPOINT: u8 = 2;

const DEVICE: [u8; 18] = [
    18,
    1,
    0x00,
    0x02, // USB 2.0
    0x02,
    0,
    0,
    MAX_PACKET_BYTES as u8, // a communication device
    0x8A,
    0x2E,
    0x0A,
    0x00, // 2e8a:000a, a serial port of an RP2040
    0x00,
    0x01,
    NAME,
    NAME,
    0,
    1,
];
const CONFIGURATION: [u8; 67] = [
    9,
    2,
    67,
    0,
    2,
    1,
    0,
    0xC0,
    50, // two interfaces; with a supply of its own
    9,
    4,
    0,
    0,
    1,
    0x02,
    0x02,
    0x00,
    NAME, // communication
    5,
    0x24,
    0x00,
    0x10,
    0x01, // CDC 1.1
    5,
    0x24,
    0x01,
    0x00,
    1, // calls are not handled
    4,
    0x24,
    0x02,
    0x02, // line coding and line state
    5,
    0x24,
    0x06,
    0,
    1, // both interfaces are one port
    7,
    5,
    0x80 | NOTIFICATION_ENDPOINT,
    3,
    8,
    0,
    255, // an interrupt endpoint
    9,
    4,
    1,
    0,
    2,
    0x0A,
    0,
    0,
    0, // data
    7,
    5,
    DATA_ENDPOINT,
    2,
    MAX_PACKET_BYTES as u8,
    0,
    0, // bulk, from the host
    7,
    5,
    0x80 | DATA_ENDPOINT,
    2,
    MAX_PACKET_BYTES as u8,
    0,
    0, // bulk, to the host
];
/// Index of the only string descriptor.
const NAME: u8 = 1;
const LANGUAGES: [u8; 4] = [4, 3, 0x09, 0x04];
const GROWBOT: [u8; 16] = [16, 3, b'g', 0, b'r', 0, b'o', 0, b'w', 0, b'b', 0, b'o', 0, b't', 0];
/// Line coding: 115200 baud, one stop bit, no parity, 8 bits. It has no effect, but hosts read it.
const CODING: [u8; 7] = [0x00, 0xC2, 0x01, 0x00, 0, 0, 8];

/// A control request of the host: the setup packet.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    kind: u8,
    request: u8,
    value: u16,
    index: u16,
    length: u16,
}

impl Setup {
    /// Decodes the eight bytes of a setup packet, which are passed as two little-endian words.
    pub const fn new(low: u32, high: u32) -> Self {
        Self {
            kind: low as u8,
            request: (low >> 8) as u8,
            value: (low >> 16) as u16,
            index: high as u16,
            length: (high >> 16) as u16,
        }
    }
}

/// Action with which the board responds to a control request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ControlResponse {
    /// Send this content, cut off after this number of bytes.
    Send(UsbContent, usize),
    /// Acknowledge the request.
    Done,
    /// Receive a line coding from the host, then acknowledge the request.
    TakeCoding,
    /// Acknowledge the request. From then on, the device has this address.
    Address(u8),
    /// Acknowledge the request. Enable the data endpoints if the value is `true`, and disable them otherwise.
    Configure(bool),
    /// Acknowledge the request, and restart the packet sequence of the endpoint with this address.
    ClearEndpoint(u8),
    /// Acknowledge the request. A program on the host has opened or closed the port.
    Opened,
    /// Refuse the request.
    Refuse,
}

/// Content that the device can send in response to a control request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UsbContent {
    /// The device descriptor.
    Device,
    /// The configuration descriptor, and all descriptors that belong to it.
    Configuration,
    /// The list of the languages of strings.
    Languages,
    /// The only string: the name of the device.
    Name,
    /// The line coding that the host has sent last.
    Coding,
    /// The status of the device, an interface or an endpoint, which is always zero.
    Status,
    /// One byte: the number of the current configuration.
    Configured,
}

/// A USB serial port: the content that it sends, and its state.
#[derive(Debug)]
pub struct UsbSerial {
    device: [u8; 18],
    configuration: [u8; 67],
    languages: [u8; 4],
    name: [u8; 16],
    coding: [u8; 7],
    status: [u8; 2],
    configured: [u8; 1],
}

impl UsbSerial {
    /// Creates a port that is not configured.
    pub const fn new() -> Self {
        Self {
            device: DEVICE,
            configuration: CONFIGURATION,
            languages: LANGUAGES,
            name: GROWBOT,
            coding: CODING,
            status: [0; 2],
            configured: [0],
        }
    }

    /// Sets the port to its state after a reset of the USB.
    pub fn reset(&mut self) {
        self.configured = [0];
    }

    /// Returns whether the host has configured the port.
    pub const fn is_configured(&self) -> bool {
        self.configured[0] != 0
    }

    /// Returns the bytes of a content that the device sends.
    pub fn content(&self, content: UsbContent) -> &[u8] {
        match content {
            UsbContent::Device => &self.device,
            UsbContent::Configuration => &self.configuration,
            UsbContent::Languages => &self.languages,
            UsbContent::Name => &self.name,
            UsbContent::Coding => &self.coding,
            UsbContent::Status => &self.status,
            UsbContent::Configured => &self.configured,
        }
    }

    /// Stores the line coding that the host has sent.
    pub fn take_coding(&mut self, bytes: impl Iterator<Item = u8>) {
        for (kept, byte) in self.coding.iter_mut().zip(bytes) {
            *kept = byte;
        }
    }

    /// Handles a control request and returns the action with which the board responds.
    pub fn answer(&mut self, setup: Setup) -> ControlResponse {
        let Setup { kind, request, value, index, length } = setup;
        let send = |content| ControlResponse::Send(content, usize::from(length));
        if kind & 0x60 == 0x20 {
            return answer_class(request, kind & 0x80 != 0, usize::from(length));
        }
        if kind & 0x60 != 0 {
            return ControlResponse::Refuse;
        }
        match (kind & 0x80 != 0, request) {
            (true, 6) => self.describe(value).map_or(ControlResponse::Refuse, send),
            (true, 0) => send(UsbContent::Status),
            (true, 8) => send(UsbContent::Configured),
            // Each interface has only one alternate setting.
            (true, 10) => ControlResponse::Send(UsbContent::Status, usize::from(length.min(1))),
            (false, 11) if value == 0 => ControlResponse::Done,
            (false, 5) => ControlResponse::Address(value as u8 & 0x7F),
            (false, 9) if value <= 1 => {
                self.configured = [value as u8];
                ControlResponse::Configure(value == 1)
            }
            (false, 1) if kind == 2 && value == 0 => ControlResponse::ClearEndpoint(index as u8),
            _ => ControlResponse::Refuse,
        }
    }

    fn describe(&self, value: u16) -> Option<UsbContent> {
        let number = value as u8;
        match value >> 8 {
            1 => Some(UsbContent::Device),
            2 => Some(UsbContent::Configuration),
            3 if number == 0 => Some(UsbContent::Languages),
            3 if number == NAME => Some(UsbContent::Name),
            _ => None,
        }
    }
}

impl Default for UsbSerial {
    fn default() -> Self {
        Self::new()
    }
}

/// Handles a request of the CDC class: SET_LINE_CODING, GET_LINE_CODING, SET_CONTROL_LINE_STATE.
fn answer_class(request: u8, to_host: bool, length: usize) -> ControlResponse {
    match (to_host, request) {
        (false, 0x20) if length == CODING.len() => ControlResponse::TakeCoding,
        (true, 0x21) => ControlResponse::Send(UsbContent::Coding, length),
        (false, 0x22) => ControlResponse::Opened,
        _ => ControlResponse::Refuse,
    }
}

#[cfg(test)]
mod tests {
    use std::vec;

    use super::*;

    fn setup(kind: u8, request: u8, value: u16, index: u16, length: u16) -> Setup {
        Setup { kind, request, value, index, length }
    }

    #[test]
    fn descriptor_lengths_are_correct_and_endpoints_are_named() {
        let serial = UsbSerial::new();
        for content in [UsbContent::Device, UsbContent::Languages, UsbContent::Name] {
            let bytes = serial.content(content);
            assert_eq!(usize::from(bytes[0]), bytes.len(), "{content:?}");
        }
        let configuration = serial.content(UsbContent::Configuration);
        assert_eq!(usize::from(configuration[2]), configuration.len());
        let (mut rest, mut endpoints) = (configuration, vec![]);
        while let [length, kind, ..] = rest {
            if *kind == 5 {
                endpoints.push(rest[2]);
            }
            rest = &rest[usize::from(*length)..];
        }
        assert_eq!(endpoints, [0x81, 0x02, 0x82]);
    }

    #[test]
    fn the_host_can_enumerate_and_use_the_port() {
        let mut serial = UsbSerial::new();
        let mut answer = |kind, request, value, length| serial.answer(setup(kind, request, value, 0, length));
        assert_eq!(answer(0x80, 6, 0x100, 64), ControlResponse::Send(UsbContent::Device, 64));
        assert_eq!(answer(0x00, 5, 7, 0), ControlResponse::Address(7));
        assert_eq!(answer(0x80, 6, 0x200, 9), ControlResponse::Send(UsbContent::Configuration, 9));
        assert_eq!(answer(0x80, 6, 0x301, 255), ControlResponse::Send(UsbContent::Name, 255));
        // The device has no qualifier, because it supports only one speed, and no second string.
        assert_eq!(answer(0x80, 6, 0x600, 10), ControlResponse::Refuse);
        assert_eq!(answer(0x80, 6, 0x302, 255), ControlResponse::Refuse);
        assert_eq!(answer(0x00, 9, 2, 0), ControlResponse::Refuse);
        assert_eq!(answer(0x00, 9, 1, 0), ControlResponse::Configure(true));
        assert_eq!(answer(0x21, 0x20, 0, 7), ControlResponse::TakeCoding);
        assert_eq!(answer(0x21, 0x22, 3, 0), ControlResponse::Opened);
        assert_eq!(answer(0x02, 1, 0, 0), ControlResponse::ClearEndpoint(0));
        assert_eq!(answer(0x40, 5, 0, 0), ControlResponse::Refuse);
        assert!(serial.is_configured());
        serial.take_coding([0x80, 0x25, 0, 0, 0, 0, 8].into_iter());
        assert_eq!(serial.content(UsbContent::Coding), [0x80, 0x25, 0, 0, 0, 0, 8]);
        serial.reset();
        assert!(!serial.is_configured());
    }
}
