"""Draws the wiring diagrams of the book: `python3 book/builder/wiring.py` writes book/src/pictures/wiring-*.svg."""

from pathlib import Path
from xml.sax.saxutils import escape

PICTURES = Path(__file__).resolve().parent.parent / "src" / "pictures"
SIGNAL, POWER = "#3b82c4", "#d9822b"
ROW = 44

SKR_PICO = (
    "wiring-skr-pico",
    "BTT SKR Pico: terminals and what hangs on them",
    "SKR Pico",
    [
        ("X-STOP", "GPIO 4", "index sensor of the head", "open collector", SIGNAL),
        ("Y-STOP", "GPIO 3", "emergency stop, contact 1", "opens when pressed", SIGNAL),
        ("E0-STOP", "GPIO 16", "filament switch", "closes on filament", SIGNAL),
        ("Z-STOP", "GPIO 25", "filament encoder", "open collector", SIGNAL),
        ("SERVOS", "GPIO 29", "orientation sensor, SDA", "4.7 kohm to 3.3 V", SIGNAL),
        ("PROBE", "GPIO 22", "orientation sensor, SCL", "4.7 kohm to 3.3 V", SIGNAL),
        ("TH0", "GPIO 27", "thermistor of the nozzle", "100 kohm NTC", SIGNAL),
        ("USB-C", "", "host", "or UART, GPIO 0 and 1", SIGNAL),
    ],
    [
        ("XM", "11, 10, 12", "motor of the head", "STEP, DIR, EN", POWER),
        ("EM", "14, 13, 15", "motor of the feed", "STEP, DIR, EN", POWER),
        ("HE -", "GPIO 23", "heater, its other end", "see the heater's circuit", POWER),
        ("HB", "GPIO 21", "second switch, its input", "relay or MOSFET module", POWER),
        ("FAN1", "GPIO 17", "fan", "12 or 24 V as VIN", POWER),
        ("VIN", "12 or 24 V", "supply, behind fuse", "and emergency stop, contact 2", POWER),
    ],
)
PICO = (
    "wiring-pico",
    "Raspberry Pi Pico: pins and what hangs on them",
    "Pico",
    [
        ("GP14", "pin 19", "index sensor of the head", "open collector", SIGNAL),
        ("GP15", "pin 20", "emergency stop, contact 1", "opens when pressed", SIGNAL),
        ("GP12", "pin 16", "filament switch", "closes on filament", SIGNAL),
        ("GP13", "pin 17", "filament encoder", "open collector", SIGNAL),
        ("GP16", "pin 21", "orientation sensor, SDA", "4.7 kohm to 3.3 V", SIGNAL),
        ("GP17", "pin 22", "orientation sensor, SCL", "4.7 kohm to 3.3 V", SIGNAL),
        ("GP26", "pin 31", "thermistor of the nozzle", "pull-up to 3V3, 100 nF", SIGNAL),
        ("GP27", "pin 32", "divider of the supply", "10 kohm and 1 kohm", SIGNAL),
        ("GP0, GP1", "pins 1, 2", "host, by USB or these", "3.3 V adapter, TX, RX crossed", SIGNAL),
    ],
    [
        ("GP2, 3, 4", "pins 4-6", "driver of the head", "STEP, DIR, EN", POWER),
        ("GP5, 6, 7", "pins 7, 9, 10", "driver of the feed", "STEP, DIR, EN", POWER),
        ("GP8", "pin 11", "heater's MOSFET, low side", "10 kohm to ground", POWER),
        ("GP9", "pin 12", "heater's second switch", "10 kohm to ground", POWER),
        ("GP10", "pin 14", "fan's MOSFET", "10 kohm to ground", POWER),
        ("GP11", "pin 15", "fault outputs, joined", "of both drivers", SIGNAL),
        ("VSYS", "pin 39", "5 V", "not by the motors' supply", POWER),
        ("GND", "pin 38", "ground of everything", "one star point", POWER),
    ],
)


class Drawing:
    def __init__(self, title, width, height):
        self.lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" role="img">',
            f"<title>{escape(title)}</title>",
            "<style>svg:root { color: #222; } "
            "@media (prefers-color-scheme: dark) { svg:root { color: #ddd; } }</style>",
        ]

    def box(self, x, y, width, height, colour="currentColor", fill=0.0):
        self.lines.append(
            f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="4" fill="{colour}" '
            f'fill-opacity="{fill}" stroke="{colour}" stroke-width="1.5"/>'
        )

    def wire(self, points, colour):
        joined = " ".join(f"{x},{y}" for x, y in points)
        self.lines.append(f'<polyline points="{joined}" fill="none" stroke="{colour}" stroke-width="2"/>')

    def text(self, x, y, words, size=13, anchor="start", weight="normal"):
        self.lines.append(
            f'<text x="{x}" y="{y}" font-family="sans-serif" font-size="{size}" text-anchor="{anchor}" '
            f'font-weight="{weight}" fill="currentColor">{escape(words)}</text>'
        )

    def write(self, name):
        (PICTURES / f"{name}.svg").write_text("\n".join([*self.lines, "</svg>"]) + "\n")


def board(name, title, label, left, right):
    """Draws a board with its terminals, and a box for each part: signals on the left, power on the right."""
    height = ROW * max(len(left), len(right)) + 60
    drawing = Drawing(title, 760, height)
    drawing.box(260, 10, 240, height - 20, fill=0.06)
    drawing.text(380, 32, label, 16, "middle", "bold")
    for side, rows in (("left", left), ("right", right)):
        for index, (terminal, pin, part, remark, colour) in enumerate(rows):
            y = 66 + index * ROW
            part_x, edge, inner, anchor = (10, 260, 268, "start") if side == "left" else (550, 500, 492, "end")
            drawing.box(part_x, y - 19, 200, 38, colour, 0.12)
            drawing.text(part_x + 10, y - 2, part)
            drawing.text(part_x + 10, y + 13, remark, 11)
            drawing.wire([(210, y), (edge, y)] if side == "left" else [(edge, y), (550, y)], colour)
            drawing.text(inner, y - 2, terminal, 13, anchor, "bold")
            drawing.text(inner, y + 13, pin, 11, anchor)
    drawing.write(name)


def heater():
    """Draws the heater's circuit: all parts in series with the heater."""
    drawing = Drawing("The heater's circuit: two switches, a fuse, a thermal cut-off and the emergency stop", 760, 230)
    parts = [
        ("supply +", "12 or 24 V"),
        ("emergency stop", "contact 2, opens"),
        ("fuse", "1.5 x heater"),
        ("second switch", "module, by HB"),
        ("thermal cut-off", "on the block"),
    ]
    for index, (part, remark) in enumerate(parts):
        x = 10 + index * 150
        drawing.box(x, 30, 130, 44, POWER, 0.12)
        drawing.text(x + 65, 50, part, 13, "middle", "bold")
        drawing.text(x + 65, 66, remark, 11, "middle")
        if index:
            drawing.wire([(x - 20, 52), (x, 52)], POWER)
    drawing.wire([(675, 74), (675, 140)], POWER)
    drawing.text(20, 20, "VIN of the board branches off behind the emergency stop, with a fuse of its own", 11)
    for x, part, remark in [
        (610, "heater", "cartridge"),
        (310, "HE -", "power stage, GPIO 23"),
        (10, "supply -", "GND"),
    ]:
        drawing.box(x, 140, 130, 44, POWER, 0.12)
        drawing.text(x + 65, 160, part, 13, "middle", "bold")
        drawing.text(x + 65, 176, remark, 11, "middle")
    drawing.wire([(610, 162), (440, 162)], POWER)
    drawing.wire([(310, 162), (140, 162)], POWER)
    drawing.text(
        20, 212, "HE + stays free: the heater's power comes by the second switch. Either switch alone keeps it off.", 11
    )
    drawing.write("wiring-heater")


board(*SKR_PICO)
board(*PICO)
heater()
