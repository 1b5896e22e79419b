// The response of each robot to the stop of all robots.

import { stopResponses } from "./robot_commands";

export function StopResponses() {
  const responses = stopResponses.value;
  if (!responses) return null;
  return (
    <section class="card stop-responses" aria-label="Responses to the stop">
      <ul role="status">
        {responses.map(({ robot, text, state }) => (
          <li key={robot} class={state}><b>{robot}</b> {text}</li>
        ))}
      </ul>
      <button type="button" onClick={() => { stopResponses.value = null; }}>Close</button>
    </section>
  );
}
