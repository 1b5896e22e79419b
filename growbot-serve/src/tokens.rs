//! Access tokens of the pages.
//!
//! A token is valid as long as the listening socket exists. While a service is not running, any user of the machine can
//! take its port and read the tokens that open pages send. So a service keeps the tokens of an earlier service only if
//! it has the same socket, which the service manager has held open in between. Otherwise it creates new tokens.

use std::fs;
use std::io;
use std::os::fd::AsFd;
use std::path::Path;

use rustix::net::sockopt::socket_cookie;

use super::secret_file::write_secret;

/// File with the random identifier that the kernel gives to each start of the machine.
const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";

/// The two access tokens of the pages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tokens {
    /// Token that allows reading and commands.
    pub control: String,
    /// Token that allows reading only.
    pub view: String,
}

impl Tokens {
    /// Returns the stored tokens if they belong to this listening socket. Otherwise creates, stores and returns new
    /// tokens.
    ///
    /// # Errors
    /// The file cannot be written, or the system has no random numbers.
    pub fn load_or_create(path: &Path, socket: impl AsFd) -> io::Result<Self> {
        Self::for_socket(path, &socket_identity(socket)?)
    }

    fn for_socket(path: &Path, socket: &str) -> io::Result<Self> {
        let is_token = |word: &str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
        let text = fs::read_to_string(path).unwrap_or_default();
        if let [control, view, of] = text.lines().collect::<Vec<_>>()[..]
            && of == socket
            && is_token(control)
            && is_token(view)
        {
            return Ok(Self { control: control.to_owned(), view: view.to_owned() });
        }
        let tokens = Self { control: new_token()?, view: new_token()? };
        write_secret(path, &format!("{}\n{}\n{socket}\n", tokens.control, tokens.view))?;
        Ok(tokens)
    }
}

/// Returns a text that identifies this socket among all earlier and later sockets of this machine.
fn socket_identity(socket: impl AsFd) -> io::Result<String> {
    let boot = fs::read_to_string(BOOT_ID)?;
    Ok(format!("socket {} of boot {}", socket_cookie(socket)?, boot.trim()))
}

/// Returns 128 random bits as 32 hexadecimal digits.
///
/// # Errors
/// The system has no random numbers.
pub fn new_token() -> io::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(io::Error::other)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn tokens_last_as_long_as_the_socket() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("tokens");
        let listen = |port| TcpListener::bind(("127.0.0.1", port)).unwrap();
        let load = |socket: &TcpListener| Tokens::load_or_create(&path, socket).unwrap();
        let first = listen(0);
        let tokens = load(&first);
        assert_ne!(tokens.control, tokens.view);
        assert_eq!(load(&first), tokens);
        assert_eq!(load(&first.try_clone().unwrap()), tokens, "the same socket with another descriptor");
        let port = first.local_addr().unwrap().port();
        drop(first);
        let second = listen(port);
        let others = load(&second);
        let all = [&tokens.control, &tokens.view, &others.control, &others.view];
        assert!(all.iter().all(|token| all.iter().filter(|other| other == &token).count() == 1), "{all:?}");
        // A stored file without the socket's identity, as an earlier release wrote it.
        fs::write(&path, format!("{}\n{}\n", others.control, others.view)).unwrap();
        assert_ne!(load(&second), others);
    }
}
