// The page of `growbot serve` as an operator finds it: everything by its role and name.

import assert from "node:assert/strict";

const escape = (text) => text.replaceAll(/[.*+?^${}()|[\]\\]/g, "\\$&");

/** Returns the parts of the page on which a person sees and commands this robot. */
export function partsOf(page, name) {
  const robot = page.getByRole("region", { name: `Robot ${name}`, exact: true });
  const nextBody = page.getByRole("region", { name: "Next body" });
  const frame = page.frameLocator(`iframe[title="3D view of the body of ${name}"]`);
  const parts = {
    robot, nextBody, frame,
    history: page.getByRole("region", { name: "History", exact: true }),
    charts: page.getByRole("region", { name: "Charts" }),
    body: page.getByRole("region", { name: "Body in three dimensions" }),
    /** The robot's state, how old it is, and the result of the latest command. */
    state: robot.getByRole("status", { name: "State", exact: true }),
    age: robot.getByRole("status", { name: "Age of the state" }),
    result: robot.getByRole("status", { name: "Result of the command" }),
    connection: page.getByRole("status", { name: "Connection" }),
    stop: page.getByRole("button", { name: /^(Emergency stop|Stop all robots)/ }),
    question: page.getByRole("dialog"),
    preview: nextBody.getByRole("status", { name: "Preview" }),
    /** Banners of orders that are not confirmed. */
    banners: page.getByRole("alert").getByRole("paragraph")
      .filter({ has: page.getByRole("button", { name: "Close" }) }),
    /** The number of layers that the 3D view shows. */
    drawnLayers: frame.getByRole("status").filter({ hasText: /^layer \d+ of \d+/ }),
    button: (label) => robot.getByRole("button", { name: label, exact: true }),
    waitForState: (state) => parts.state.filter({ hasText: new RegExp(`^(${state})$`) }).waitFor(),
    /** Returns the number of laid layers. */
    async laidLayers() {
      const progress = robot.getByText(/^Layer \d+ of \d+$/);
      return await progress.count() ? Number(/\d+/.exec(await progress.innerText())) : 0;
    },
    /** Types a goal into its fields: X, Y, Z, heading and pitch. */
    async typeGoal(text) {
      const labels = ["X, mm", "Y, mm", "Z, mm", "Heading, °", "Pitch, °"];
      const goal = nextBody.getByRole("group", { name: "Goal", exact: true });
      for (const [index, part] of text.split(",").entries()) {
        await goal.getByLabel(labels[index], { exact: true }).fill(part.trim());
      }
    },
    /** Confirms the open question, once that is possible. */
    async confirm(action) {
      await parts.question.getByRole("button", { name: action, exact: true }).click();
    },
    job: (text) => parts.history.getByRole("row").filter({ hasText: new RegExp(escape(text)) }).first(),
  };
  return parts;
}

/** Opens a page of the service. Errors of its scripts are added to `errors`. */
export async function openPage(browser, url, { timeoutMs, errors }) {
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  page.setDefaultTimeout(timeoutMs);
  page.on("pageerror", (error) => errors.push(error.message));
  await page.goto(url);
  return page;
}

/** Checks a page with axe, a checker of accessibility. Its source is `axe`. */
export async function checkAccessibility(page, axe, what) {
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document, { iframes: false }));
  const found = violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html, failureSummary }) =>
    `${html.slice(0, 160)} (${failureSummary})`).join("; ")}`);
  assert.deepEqual(found, [], what);
}

/** Checks that nothing scrolls sideways. */
export async function checkWidth(page, what) {
  // The page takes its new width some time after the window.
  const fits = page.waitForFunction(() => document.documentElement.scrollWidth <= window.innerWidth);
  await fits.catch(() => assert.fail(`${what} scrolls sideways`));
}

/** Checks that each control can be hit by a finger: it is at least 44 px high. */
export async function checkTargets(page) {
  const small = await page.evaluate(() => {
    const isSmall = (control) => {
      const { height } = (control.closest("label.check") ?? control).getBoundingClientRect();
      return height > 0 && height < 43.5;
    };
    const controls = [...document.querySelectorAll("button, a, select, input")];
    return controls.filter(isSmall).map((control) => control.outerHTML.slice(0, 120));
  });
  assert.deepEqual(small, []);
}
