// Question before an order that heats, or that destroys something.

import { signal } from "@preact/signals";

export interface Question {
  title: string;
  text: string;
  /** Label of the button that confirms. */
  action: string;
  /** True if the order destroys something. False if it heats. */
  destroys: boolean;
}

export interface OpenQuestion extends Question {
  /** Number of the question on this page. */
  id: number;
  answer(isConfirmed: boolean): void;
}

/** The open question. Null if there is none. */
export const openQuestion = signal<OpenQuestion | null>(null);

let count = 0;

/** Shows a question. Returns a promise of true if the person confirms. */
export function ask(question: Question): Promise<boolean> {
  if (openQuestion.value) return Promise.resolve(false);
  const previousFocus = document.activeElement as HTMLElement | null;
  return new Promise((resolve) => {
    count += 1;
    openQuestion.value = {
      ...question,
      id: count,
      answer(isConfirmed) {
        openQuestion.value = null;
        // The page takes the focus again once it is drawn.
        requestAnimationFrame(() => previousFocus?.focus());
        resolve(isConfirmed);
      },
    };
  });
}
