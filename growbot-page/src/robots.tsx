// The page of the service. It shows the state that the service reports and sends the person's commands.

import "./language";
import { render } from "preact";
import { startNotifications } from "./browser_notifications";
import { connect } from "./connection_state";
import { Page } from "./Page";
import { fragment } from "./page_state";

window.addEventListener("hashchange", () => { fragment.value = location.hash; });
render(<Page />, document.body);
connect();
startNotifications();
