// Environment of programs that the checks start. It lacks growbot's settings: no check moves the configured robot.

const others = Object.entries(process.env).filter(([name]) => !name.startsWith("GROWBOT_"));

export const environment = Object.fromEntries(others);
