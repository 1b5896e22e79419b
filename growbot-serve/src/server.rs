//! The server of the pages and the API: on the loopback interface, where requests need a token, and on a Unix socket of
//! the user.

use std::net::TcpListener as StdTcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::{fs, io};

use growbot_remote::api::PageUrls;
use tokio::net::{TcpListener, UnixListener};

use super::access::Access;
use super::audit::CommandSource;
use super::config::ServeEntry;
use super::connections::ConnectionLimiter;
use super::page_listener::listen;
use super::paths::ServicePaths;
pub use super::server_error::{HandOverError, ServerError};
use super::service::Service;
use super::site::Site;
use super::state_lock::StateLock;
use super::tokens::Tokens;
use super::{api, page, workers};
use crate::watch::allowed_origins::AllowedOrigins;

/// The bound listeners, before they are served.
pub struct Server {
    tcp: TcpListener,
    unix: UnixListener,
    tokens: Tokens,
    /// Lock of the data folder, held as long as the service runs.
    _lock: StateLock,
}

impl Server {
    /// Locks the data folder, and binds the Unix socket and the TCP socket of the pages. A handed-over socket is used
    /// for the pages. Without one, this port is bound. 0 stands for any free port.
    ///
    /// # Errors
    /// [`ServerError`].
    pub async fn bind(
        places: &ServicePaths,
        handed_over: Option<StdTcpListener>,
        port: u16,
    ) -> Result<Self, ServerError> {
        let file = |path: &Path| {
            let path = path.to_path_buf();
            move |error| ServerError::File { path, error }
        };
        places.check()?;
        let lock = StateLock::acquire(places)?;
        let socket = places.socket();
        // A service that was killed leaves its socket behind.
        let _ = fs::remove_file(&socket);
        let unix = UnixListener::bind(&socket).map_err(file(&socket))?;
        fs::set_permissions(&socket, fs::Permissions::from_mode(0o600)).map_err(file(&socket))?;
        let tcp = listen(handed_over, port).await?;
        let tokens = Tokens::load_or_create(&places.tokens(), &tcp).map_err(file(&places.tokens()))?;
        Ok(Self { tcp, unix, tokens, _lock: lock })
    }

    /// Returns the URLs of the page: first the URL that allows commands, then the read-only URL.
    ///
    /// # Errors
    /// The local address cannot be read.
    pub fn page_urls(&self) -> io::Result<[String; 2]> {
        let bound = self.tcp.local_addr()?;
        Ok([&self.tokens.control, &self.tokens.view].map(|token| format!("http://{bound}/{token}/")))
    }

    /// Serves until a listener fails, with the allowed origins and the request timeout of these settings.
    ///
    /// # Errors
    /// A listener has failed.
    pub async fn serve(self, service: Arc<Service>, settings: &ServeEntry) -> io::Result<()> {
        let [operate, look] = self.page_urls()?;
        // The addresses are set once, because a server is served once.
        let _ = service.addresses.set(PageUrls { control_url: operate, view_url: look });
        let site = Site::new(service, page::routes(), api::routes(), workers::start()?);
        let [page_door, command_door] = [(); 2].map(|()| ConnectionLimiter::new(settings.request()));
        let Tokens { control, view } = &self.tokens;
        let tokens = [(&**control, Access::Control(CommandSource::Web)), (&**view, Access::View)];
        let pages = site.for_tokens(&tokens, &page_door, AllowedOrigins::new(&settings.origins));
        let commands = site.for_clients(Access::Control(CommandSource::Socket), &command_door);
        let tcp = page_door.serve(self.tcp, pages);
        let unix = command_door.serve(self.unix, commands);
        tokio::select! { ended = tcp => ended, ended = unix => ended }
    }
}
