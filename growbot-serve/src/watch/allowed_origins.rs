//! Addresses of reverse proxies under which browsers may show the pages.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

/// Origin of a page as browsers send it, such as `https://robots.example`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(try_from = "String")]
#[schemars(with = "String")]
pub struct Origin(String);

/// Error for a text that is not an origin.
#[derive(Debug, thiserror::Error)]
#[error("{0:?} is not the origin of a page: write scheme and host, without a path, for example https://robots.example")]
pub struct OriginError(String);

impl TryFrom<String> for Origin {
    type Error = OriginError;

    fn try_from(text: String) -> Result<Self, OriginError> {
        let is_part = |byte: u8| byte.is_ascii_alphanumeric() || b".-:[]".contains(&byte);
        let lower = text.to_ascii_lowercase();
        match lower.split_once("://") {
            Some((scheme @ ("http" | "https"), host)) if !host.is_empty() && host.bytes().all(is_part) => {
                // Browsers leave out the default port.
                let default = if scheme == "https" { ":443" } else { ":80" };
                Ok(Self(format!("{scheme}://{}", host.strip_suffix(default).unwrap_or(host))))
            }
            _ => Err(OriginError(text)),
        }
    }
}

impl Origin {
    /// Returns true if this `Host` header is the host of the origin.
    fn has_host(&self, host: &str) -> bool {
        self.0.split_once("://").is_some_and(|(_, own)| own.eq_ignore_ascii_case(host))
    }
}

/// Origins of the configured reverse proxies. Pages of the loopback interface are allowed in addition.
#[derive(Debug, Clone, Default)]
pub struct AllowedOrigins(Arc<[Origin]>);

impl AllowedOrigins {
    /// Creates the list of allowed origins.
    pub fn new(origins: &[Origin]) -> Self {
        Self(origins.into())
    }

    /// Returns true if this `Host` header is the host of one of the proxies.
    pub fn has_host(&self, host: &str) -> bool {
        self.0.iter().any(|origin| origin.has_host(host))
    }

    /// Returns true if this `Origin` header is in the list.
    pub fn contains(&self, origin: &str) -> bool {
        self.0.iter().any(|own| own.0 == origin)
    }

    /// Returns true if this `Host` header is the host of a proxy that browsers reach over HTTPS.
    pub fn is_https(&self, host: &str) -> bool {
        self.0.iter().any(|origin| origin.has_host(host) && origin.0.starts_with("https:"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_are_scheme_and_host() {
        for (text, origin) in [
            ("https://robots.example", "https://robots.example"),
            ("HTTPS://Robots.Example:443", "https://robots.example"),
            ("https://robots.example:8443", "https://robots.example:8443"),
            ("http://[::1]:80", "http://[::1]"),
        ] {
            assert_eq!(Origin::try_from(text.to_owned()).unwrap().0, origin, "{text}");
        }
        for text in ["robots.example", "https://", "https://robots.example/", "ftp://robots.example", "*", "https://*"]
        {
            let refused = Origin::try_from(text.to_owned()).unwrap_err().to_string();
            assert!(refused.contains(text) && refused.contains("https://robots.example"), "{refused}");
        }
    }
}
