// A browser may name a language that it cannot format numbers for, such as "C". The charts would then fail as they are
// loaded, and the page would have no emergency stop. This file is imported before them.

try {
  new Intl.NumberFormat(navigator.language);
} catch {
  Object.defineProperty(navigator, "language", { value: "en" });
}
