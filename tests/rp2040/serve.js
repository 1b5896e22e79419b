// A board in rp2040js behind a TCP port, with the signals of a robot at rest.
import { createServer } from "node:net";

/** Applies the signals of a robot at rest, at 25 C and 12 V. */
export function rest(board) {
    // 100 kOhm below 4.7 kOhm, and 12 V of 36.3 V.
    board.convert(0, 3911);
    board.convert(1, 1354);
    // Drivers without a fault, with filament, off the index mark, stop not pressed.
    board.put(11, true);
    board.put(12, false);
    board.put(14, true);
    board.put(15, false);
}

/** Serves a board on a TCP port in real time. `onBytes` is called with bytes for the board before it receives them. */
export async function serve(board, onBytes = () => {}) {
    let line;
    const arrived = [];
    const server = createServer((socket) => {
        line = socket.setNoDelay(true);
        socket.on("data", (bytes) => arrived.push(...bytes));
        socket.on("error", () => {});
    });
    await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
    const timer = setInterval(() => {
        board.run(10);
        if (arrived.length) {
            const bytes = arrived.splice(0);
            onBytes(bytes);
            board.send(bytes);
        }
        if (board.sent.length && line?.writable) line.write(Buffer.from(board.sent.splice(0)));
    }, 10);
    const stop = () => {
        clearInterval(timer);
        line?.destroy();
        server.close();
    };
    return { port: `tcp:127.0.0.1:${server.address().port}`, stop };
}
