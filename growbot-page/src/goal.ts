// A goal as it is typed into five fields.

export const FIELDS = [
  { name: "x", label: "X, mm" }, { name: "y", label: "Y, mm" }, { name: "z", label: "Z, mm" },
  { name: "heading", label: "Heading, °" }, { name: "pitch", label: "Pitch, °" },
] as const;

export type FieldName = (typeof FIELDS)[number]["name"];
export type Goal = Record<FieldName, string>;

/** A goal or a waypoint: a pose, or a position for any direction. */
export interface Target {
  fields: Goal;
  anyDirection: boolean;
}

export const EMPTY_GOAL: Goal = { x: "", y: "", z: "", heading: "", pitch: "" };
export const EMPTY_TARGET: Target = { fields: EMPTY_GOAL, anyDirection: false };
/** A waypoint without numbers. Most are positions. */
export const EMPTY_WAYPOINT: Target = { fields: EMPTY_GOAL, anyDirection: true };
const POSITION: FieldName[] = ["x", "y", "z"];

/** Returns the fields of a goal: the position only if any direction is right. */
export const fieldsOf = (anyDirection: boolean): FieldName[] =>
  anyDirection ? POSITION : FIELDS.map(({ name }) => name);

/** Returns the target as the API takes it: X,Y,Z,HEADING,PITCH or X,Y,Z. */
export const targetText = ({ fields, anyDirection }: Target) =>
  fieldsOf(anyDirection).map((name) => fields[name].trim()).join(",");

/** Returns the first field without a value. `undefined` if all have one. */
export const missingField = ({ fields, anyDirection }: Target) =>
  fieldsOf(anyDirection).find((name) => fields[name].trim() === "");

/**
 * Returns the goal with a text that was typed or pasted into a field. A list of numbers fills this field and the ones
 * after it.
 */
export function withText(goal: Goal, field: FieldName, text: string): Goal {
  const parts = text.trim().split(/\s*[,;]\s*/);
  if (parts.length < 2) return { ...goal, [field]: text };
  const names = FIELDS.map(({ name }) => name);
  const first = names.indexOf(field);
  const filled = { ...goal };
  parts.slice(0, names.length - first).forEach((part, index) => { filled[names[first + index]] = part; });
  return filled;
}

/** Where a problem is: a field of the goal, or of a waypoint, which has a number from 1. */
export interface ProblemPlace {
  field?: FieldName;
  waypoint?: number;
}

/** Returns the place that an error of the service is about. It is empty if the error names none. */
export function placeOfError(message: string): ProblemPlace {
  const [, number, detail] = /^(?:waypoint (\d+): )?([^]*)$/.exec(message) ?? [];
  const field = FIELDS.find(({ name }) => detail.startsWith(`${name} is `))?.name;
  return { field, waypoint: number === undefined ? undefined : Number(number) };
}
