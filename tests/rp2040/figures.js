// Cost of the step interrupt, in cycles, and depth of the stack. Both are written to a file every few seconds.
import { writeFileSync } from 'node:fs';

/** Exception number of PWM_IRQ_WRAP. */
const STEP = 16 + 4;
/** Cycles of the processor for entry and exit of an exception, which the emulator does not count. */
const ENTRY_AND_RETURN = 15 + 15;
/** Top of the stack (growbot-firmware/memory/pico.x), and number of interrupts between two writes of the file. */
const STACK = 0x20010000;
const EVERY = 5_000;

/** Starts the measurement of a core. */
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
