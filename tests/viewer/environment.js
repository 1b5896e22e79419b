// Environment of programs that the checks start. It lacks the configured port of a robot, so that no check moves it.

const { GROWBOT_PORT: _, ...others } = process.env;

export const environment = others;
