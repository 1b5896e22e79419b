// The header: robots, whether the data are current, and the emergency stop. Nothing in it changes its height or the
// place of the stop.

import { connectionText } from "./connection_state";
import { EmergencyStop } from "./EmergencyStop";
import { fragmentOf, heardAt, now, robots, selectedName } from "./page_state";

export function Header() {
  const names = [...robots.value.keys()];
  const selected = selectedName.value;
  const text = connectionText.value;
  const age = heardAt.value === null ? "" : `, updated ${((now.value - heardAt.value) / 1000).toFixed(0)} s ago`;
  return (
    <header class={names.length > 1 ? "several" : ""}>
      <h1>growbot</h1>
      {names.length > 1 && (
        <nav aria-label="Robots">
          {names.map((name) => (
            <a key={name} href={fragmentOf(name)} aria-current={name === selected ? "page" : undefined}>{name}</a>
          ))}
          <a href="#" aria-current={selected === null ? "page" : undefined}>All robots</a>
        </nav>
      )}
      <p class={text === "Live" ? "connection live" : "connection"}>
        <span role="status" aria-label="Connection">{text}</span>
        {/* A screen reader would announce each second. */}
        {text === "Live" && <span aria-hidden="true">{age}</span>}
      </p>
      <EmergencyStop />
    </header>
  );
}
