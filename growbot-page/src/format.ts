// Numbers, times and names as text.

export const formatTime = (utc: string | number) =>
  new Date(utc).toLocaleString([], { dateStyle: "short", timeStyle: "short" });

export const formatClock = (utc: string) => new Date(utc).toLocaleTimeString([], { timeStyle: "short" });

/** Formats a number with this many decimals, without a minus before zeros. */
export const formatNumber = (number: number, decimals: number) =>
  (Math.abs(number) < 0.5 * 10 ** -decimals ? 0 : number).toFixed(decimals);

export function formatDuration(seconds: number): string {
  const minutes = Math.round(seconds / 60);
  if (minutes < 1) return `${Math.round(seconds)} s`;
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Returns a name with words instead of hyphens, and a capital. */
export function formatTitle(name: string): string {
  const words = name.replaceAll("-", " ");
  return words[0].toUpperCase() + words.slice(1);
}
