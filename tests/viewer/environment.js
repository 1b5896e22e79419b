// What programs that the checks start know of this machine: all but the port of a robot that is configured here, which
// no check is to move.

const { GROWBOT_PORT: _, ...others } = process.env;

export const environment = others;
