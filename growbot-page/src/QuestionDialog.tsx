// The open question. It leaves the header uncovered, so that the emergency stop works meanwhile.

import { useEffect, useRef, useState } from "preact/hooks";
import { openQuestion } from "./question";
import type { OpenQuestion } from "./question";

/** Time before the answer can be given, so that a double click on the button before it does not answer. */
const ARM_MS = 1_000;

export function QuestionDialog() {
  const question = openQuestion.value;
  // Each question has a dialog of its own, which is not armed yet.
  return question && <Dialog key={question.id} question={question} />;
}

function Dialog({ question }: { question: OpenQuestion }) {
  const keep = useRef<HTMLButtonElement>(null);
  const [isArmed, setArmed] = useState(false);
  useEffect(() => {
    const timer = setTimeout(() => setArmed(true), ARM_MS);
    keep.current?.focus();
    const onKey = (event: KeyboardEvent) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      question.answer(false);
    };
    document.addEventListener("keydown", onKey, true);
    return () => {
      clearTimeout(timer);
      document.removeEventListener("keydown", onKey, true);
    };
  }, [question]);
  const { title, text, action, destroys, answer } = question;
  return (
    <>
      <div class="shade" />
      {/* A modal dialog would block the emergency stop. */}
      <dialog open class="question" aria-labelledby="question-title" aria-describedby="question-text">
        <h2 id="question-title">{title}</h2>
        <p id="question-text">{text}</p>
        <div class="row">
          <button type="button" ref={keep} onClick={() => answer(false)}>{destroys ? "Keep" : "Cancel"}</button>
          <button
            type="button" class={destroys ? "danger" : "primary"} disabled={!isArmed} onClick={() => answer(true)}
          >
            {action}
          </button>
        </div>
      </dialog>
    </>
  );
}
