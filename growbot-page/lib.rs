//! The web page of the service, for operators: its files, as the service sends them.
//!
//! The sources are in `src`, in TypeScript with Preact and uPlot. `npm run build` bundles them into `dist`, which the
//! repository contains, so that no build needs npm. The page uses the API of growbot-serve alone.
#![forbid(unsafe_code)]

/// The HTML of the page.
pub const PAGE: &str = include_str!("dist/robots.html");
/// The style sheet, `robots.css`.
pub const STYLE: &str = include_str!("dist/robots.css");
/// Scripts of the page: file name and content.
pub const SCRIPTS: [(&str, &str); 2] =
    [("robots.js", include_str!("dist/robots.js")), ("events-worker.js", include_str!("dist/events-worker.js"))];
