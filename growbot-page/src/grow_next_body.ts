// The order to grow what is entered as the next body.

import { confirmGrowth } from "./growth_question";
import { formOf, grow, preview } from "./next_body";
import { optionsText } from "./queued_bodies";

/** Plans what is entered, asks, and grows it. Returns whether a person has confirmed it. */
export async function confirmGrow(name: string): Promise<boolean> {
  if (!formOf(name).plan && !await preview(name)) return false;
  // What is confirmed is what grows, even if something else is entered while the question is open.
  const form = formOf(name);
  const { plan } = form;
  if (!plan) return false;
  const { layers, duration_s: durationS } = plan;
  const startsAtLastTip = Boolean(plan.existing_layers);
  const options = optionsText({ ...form, ignore_scene: form.ignoreScene });
  const growth = { title: `Grow on ${name}?`, layers, durationS, options, startsAtLastTip };
  const isConfirmed = await confirmGrowth(name, growth);
  if (isConfirmed) await grow(name, form);
  return isConfirmed;
}
