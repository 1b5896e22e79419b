// Red banners at the bottom of the window, where they move nothing.

import { signal } from "@preact/signals";

export interface Banner {
  id: number;
  text: string;
}

export const banners = signal<Banner[]>([]);
let latestId = 0;

/** A banner on the page, which its order changes and removes. A person can close it. */
export interface BannerHandle {
  setText(text: string): void;
  close(): void;
  isOpen(): boolean;
}

export function closeBanner(id: number): void {
  banners.value = banners.value.filter((banner) => banner.id !== id);
}

export function showBanner(text: string): BannerHandle {
  latestId += 1;
  const id = latestId;
  banners.value = [...banners.value, { id, text }];
  return {
    setText(next) { banners.value = banners.value.map((banner) => (banner.id === id ? { id, text: next } : banner)); },
    close: () => closeBanner(id),
    isOpen: () => banners.value.some((banner) => banner.id === id),
  };
}
