// The switch for notifications of this browser.

import { canNotify, isNotified, notificationProblem, setNotified } from "./browser_notifications";

export function NotificationSwitch() {
  return (
    <div class="card">
      <label class="check">
        <input
          type="checkbox" checked={isNotified.value} disabled={!canNotify}
          onChange={({ currentTarget }) => void setNotified(currentTarget.checked)}
        />
        Notify me in this browser when a growth ends or a robot needs a person
      </label>
      <p class="note" role="status" aria-label="Problem of notifications">{notificationProblem.value}</p>
    </div>
  );
}
