// What the step interrupt costs, in cycles, and how deep the stack gets. Both are written to a file every few seconds.
import { writeFileSync } from 'node:fs';

/** The exception's number of PWM_IRQ_WRAP. */
const STEP = 16 + 4;
/** Cycles of the processor to enter an exception and to leave it, which the emulator does not count. */
const ENTRY_AND_RETURN = 15 + 15;
/** The top of the stack (growbot-firmware/memory/pico.x), and how often the file is written, interrupts. */
const STACK = 0x20010000;
const EVERY = 5_000;

/** Has a core measure from now on. */
export function measure(core, file) {
    const execute = core.executeInstruction.bind(core);
    let [cycles, interrupts, total, longest, lowest, instructions] = [0, 0, 0, 0, STACK, 0];
    core.executeInstruction = () => {
        const before = core.IPSR === STEP;
        const spent = execute();
        const after = core.IPSR === STEP;
        instructions += 1;
        lowest = Math.min(lowest, core.SP);
        if (before || after) cycles += spent;
        if (before && !after) {
            cycles += ENTRY_AND_RETURN;
            interrupts += 1;
            total += cycles;
            longest = Math.max(longest, cycles);
            cycles = 0;
            if (interrupts % EVERY === 0) {
                const mean = Math.round(total / interrupts);
                const stack = STACK - lowest;
                writeFileSync(file, JSON.stringify({ interrupts, mean, longest, stack, instructions }));
            }
        }
        return spent;
    };
}
