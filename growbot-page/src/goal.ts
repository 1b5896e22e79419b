// A goal as it is typed into five fields.

export const FIELDS = [
  { name: "x", label: "X, mm" }, { name: "y", label: "Y, mm" }, { name: "z", label: "Z, mm" },
  { name: "heading", label: "Heading, °" }, { name: "pitch", label: "Pitch, °" },
] as const;

export type FieldName = (typeof FIELDS)[number]["name"];
export type Goal = Record<FieldName, string>;

export const EMPTY_GOAL: Goal = { x: "", y: "", z: "", heading: "", pitch: "" };
const POSITION: FieldName[] = ["x", "y", "z"];

/** Returns the fields of a goal: the position only if any direction is right. */
export const fieldsOf = (anyDirection: boolean): FieldName[] =>
  anyDirection ? POSITION : FIELDS.map(({ name }) => name);

/** Returns the goal as the API takes it: X,Y,Z,HEADING,PITCH or X,Y,Z. */
export const goalText = (goal: Goal, anyDirection: boolean) =>
  fieldsOf(anyDirection).map((name) => goal[name].trim()).join(",");

/** Returns the first field without a value. `undefined` if all have one. */
export const missingField = (goal: Goal, anyDirection: boolean) =>
  fieldsOf(anyDirection).find((name) => goal[name].trim() === "");

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

/** Returns an error of the service with the field that it is about. The field is `undefined` if it names none. */
export function fieldOfError(message: string): { field?: FieldName; message: string } {
  const field = FIELDS.find(({ name }) => message.startsWith(`${name} is `))?.name;
  return { field, message };
}
