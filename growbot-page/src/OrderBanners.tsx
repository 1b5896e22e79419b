// Red banners of orders that are not confirmed.

import { banners, closeBanner } from "./banners";

export function OrderBanners() {
  return (
    <div id="banners" role="alert">
      {banners.value.map(({ id, text }) => (
        <p key={id}><span>{text}</span><button type="button" onClick={() => closeBanner(id)}>Close</button></p>
      ))}
    </div>
  );
}
