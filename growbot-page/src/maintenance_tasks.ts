// Maintenance tasks of a robot.

export interface MaintenanceTask {
  name: string;
  label: string;
  /** What the task does. */
  effect: string;
  /** Label of the value. Undefined if the task has none. */
  value?: string;
  /** True if the task is possible in a pause, to change filament. */
  inPause?: boolean;
}

const LENGTH = "Length in mm, or a material";

export const TASKS: MaintenanceTask[] = [
  {
    name: "preheat", label: "Preheat", inPause: true, value: "Temperature in °C, or a material",
    effect: "Heats the nozzle; without a value to the temperature of growth.",
  },
  {
    name: "load", label: "Load", inPause: true, value: LENGTH,
    effect: "Pushes filament to the nozzle, by default 60 mm.",
  },
  { name: "unload", label: "Unload", inPause: true, value: LENGTH, effect: "Pulls filament out, by default 80 mm." },
  {
    name: "purge", label: "Purge", inPause: true, value: LENGTH,
    effect: "Pushes filament through the hot nozzle, by default 30 mm.",
  },
  { name: "home", label: "Home", effect: "Turns the head to its index mark." },
  { name: "rotate", label: "Rotate head", value: "Angle in degrees", effect: "Turns the head." },
  { name: "jog", label: "Jog feed", value: "Length in mm, negative to retract", effect: "Moves filament." },
  { name: "dry-run", label: "Dry run", effect: "Switches the motors on, with the heater off." },
  { name: "cooldown", label: "Cool down", effect: "Switches heater and motors off." },
];
