//! The interface on the loopback interface, behind tokens, and on a socket of the user's.

use std::fs;
use std::io::{self, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::sync::Arc;

use aide::openapi::OpenApi;
use axum::extract::Request;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::{from_fn, map_request};
use axum::response::Html;
use axum::routing::get;
use axum::{Extension, Json, Router};
use tokio::net::{TcpListener, UnixListener, UnixStream};

use super::api::{self, Access};
use super::audit::By;
use super::{Places, Service};
use crate::watch::guard::{guard, nothing};
use crate::watch::token;

/// The page of all robots.
const PAGE: &str = include_str!("../../viewer/robots/robots.html");
const SCRIPT: &str = include_str!("../../viewer/robots/robots.js");
const STYLE: &str = include_str!("../../viewer/robots/robots.css");
/// What the page may load: what comes from the service alone.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; frame-src 'self'; \
                      form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/// Why the service cannot be reached.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address is taken.
    #[error("cannot serve pages at 127.0.0.1:{port} ({error}): choose another port with --page-port")]
    Address {
        /// The port asked for, 0 for any.
        port: u16,
        /// The system's reason.
        error: io::Error,
    },
    /// Another service has the socket.
    #[error("another growbot serve of this user is running: its socket is {0}; end that one first")]
    Running(String),
    /// A file cannot be used.
    #[error("cannot use {path}: {error}")]
    File {
        /// The file.
        path: String,
        /// The system's reason.
        error: io::Error,
    },
}

/// The secrets in the addresses: they stay the same, so that pages find the service again.
pub struct Tokens {
    operate: String,
    read: String,
}

impl Tokens {
    /// Those of a file, which is made where it is not there.
    fn of(path: &Path) -> io::Result<Self> {
        let is_token = |word: &&str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
        if let Ok(text) = fs::read_to_string(path)
            && let [operate, read] = text.split_whitespace().filter(is_token).collect::<Vec<_>>()[..]
        {
            return Ok(Self { operate: operate.to_owned(), read: read.to_owned() });
        }
        let tokens = Self { operate: new_token()?, read: new_token()? };
        let aside = path.with_extension("new");
        let mut file = fs::File::options().write(true).create(true).truncate(true).mode(0o600).open(&aside)?;
        writeln!(file, "{}\n{}", tokens.operate, tokens.read)?;
        file.sync_all()?;
        fs::rename(&aside, path)?;
        Ok(tokens)
    }
}

fn new_token() -> io::Result<String> {
    token().map_err(|error| io::Error::other(error.to_string()))
}

/// Everything bound, before it is served.
pub struct Server {
    tcp: TcpListener,
    unix: UnixListener,
    tokens: Tokens,
}

impl Server {
    /// Binds the address of the pages on this port, 0 for any, and the socket.
    ///
    /// # Errors
    /// [`ServerError`].
    pub async fn bind(places: &Places, port: u16) -> Result<Self, ServerError> {
        let file = |path: &Path| {
            let path = path.display().to_string();
            move |error| ServerError::File { path, error }
        };
        let socket = places.socket();
        if UnixStream::connect(&socket).await.is_ok() {
            return Err(ServerError::Running(socket.display().to_string()));
        }
        // A service that was killed has left it.
        let _ = fs::remove_file(&socket);
        let unix = UnixListener::bind(&socket).map_err(file(&socket))?;
        fs::set_permissions(&socket, fs::Permissions::from_mode(0o600)).map_err(file(&socket))?;
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let tcp = TcpListener::bind(address).await.map_err(|error| ServerError::Address { port, error })?;
        let tokens = Tokens::of(&places.tokens()).map_err(file(&places.tokens()))?;
        Ok(Self { tcp, unix, tokens })
    }

    /// The page's address for those who may give orders, and for those who may look.
    ///
    /// # Errors
    /// The system's.
    pub fn addresses(&self) -> io::Result<[String; 2]> {
        let bound = self.tcp.local_addr()?;
        Ok([&self.tokens.operate, &self.tokens.read].map(|token| format!("http://{bound}/{token}/")))
    }

    /// Serves for ever.
    ///
    /// # Errors
    /// The system's.
    pub async fn serve(self, service: Arc<Service>) -> io::Result<()> {
        let (router, document) = api::routes();
        let document = Arc::new(document);
        let site = |access| site(router.clone(), Arc::clone(&document), access).with_state(Arc::clone(&service));
        let pages = Router::new()
            .nest(&format!("/{}/", self.tokens.operate), site(Access::Operate(By::Page)))
            .nest(&format!("/{}/", self.tokens.read), site(Access::Read))
            .fallback(nothing)
            .layer(from_fn(guard));
        let commands = site(Access::Operate(By::Command));
        let tcp = axum::serve(self.tcp, pages).into_future();
        let unix = axum::serve(self.unix, commands).into_future();
        tokio::select! { ended = tcp => ended, ended = unix => ended }
    }
}

/// The page and the interface for who has such access.
fn site(router: Router<Arc<Service>>, document: Arc<OpenApi>, access: Access) -> Router<Arc<Service>> {
    let openapi = move || {
        let document = Arc::clone(&document);
        async move { Json(OpenApi::clone(&document)) }
    };
    let insert = move |mut request: Request| async move {
        request.extensions_mut().insert(access);
        request
    };
    Router::new()
        .route("/", get(|| async { ([("content-security-policy", POLICY)], Html(PAGE)) }))
        .route("/robots.js", get(|| async { ([(CONTENT_TYPE, "text/javascript")], SCRIPT) }))
        .route("/robots.css", get(|| async { ([(CONTENT_TYPE, "text/css")], STYLE) }))
        .route(&format!("{}/openapi.json", api::PREFIX), get(openapi))
        .nest(api::PREFIX, router)
        .layer(map_request(insert))
        .layer(Extension(access))
}
