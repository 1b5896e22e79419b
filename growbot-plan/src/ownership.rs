//! Check of files and folders by owner and mode, as `ssh` and `git` do it. growbot uses only what no other user can
//! have written.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::process::geteuid;

/// User number of the administrator, whose files every user trusts.
const ROOT: u32 = 0;
/// Mask of the permission bits in the mode of a file.
const PERMISSIONS: u32 = 0o7777;
/// Mode bit of a folder in which users can rename and remove their own files only.
const STICKY: u32 = 0o1000;
/// Maximum number of symbolic links that are followed one after another, as in Linux.
const MAX_LINKS: usize = 40;

/// Protection that a file or folder must have from other users.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protection {
    /// Others cannot write.
    Write,
    /// Others can neither read nor write.
    Access,
}

/// Errors of the check.
#[derive(Debug, thiserror::Error)]
pub enum OwnershipError {
    /// Another user owns the file or folder.
    #[error(
        "{path} belongs to user {owner}, but this command runs as user {user} and trusts only files of this user and \
         of root: work in a folder of your own, or, if you trust the content of {path}, run `chown {user} {path}` as \
         root",
        path = .path.display()
    )]
    Owner {
        /// Path of the file or folder.
        path: PathBuf,
        /// User number of its owner.
        owner: u32,
        /// User number of this process.
        user: u32,
    },
    /// The permissions of the file or folder let other users read or write more than the protection allows.
    #[error(
        "{path} has mode {mode:04o}, so other users can {}: check its content, then run `chmod {} {path}`",
        match .protection { Protection::Write => "change it", Protection::Access => "access it" },
        match .protection { Protection::Write => "go-w", Protection::Access => "go-rwx" },
        path = .path.display()
    )]
    Mode {
        /// Path of the file or folder.
        path: PathBuf,
        /// Permission bits of its mode.
        mode: u32,
        /// Protection that the mode does not give.
        protection: Protection,
    },
    /// The owner and the mode cannot be read.
    #[error("cannot read the owner and mode of {path}: {error}", path = .path.display())]
    Unknown {
        /// Path of the file or folder.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
}

/// Owner and permissions of a file or folder.
#[derive(Debug, Clone, Copy)]
struct Ownership {
    owner: u32,
    mode: u32,
    is_folder: bool,
    /// True if the group of the file has no members except the user of this process and root.
    has_private_group: bool,
}

/// Property that makes a file or folder unsafe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Weakness {
    Owner,
    Mode,
}

/// Returns the property that makes a file or folder unsafe for this user. `None` if it is safe. In a folder with the
/// sticky bit, such as `/tmp`, users can write but cannot change each other's files, so it is safe. A group whose
/// only member is the user, which many systems create, may have write permission.
fn weakness(user: u32, found: Ownership, protection: Protection) -> Option<Weakness> {
    let forbidden = match protection {
        Protection::Write if found.is_folder && found.mode & STICKY != 0 => 0,
        Protection::Write if found.has_private_group => 0o002,
        Protection::Write => 0o022,
        Protection::Access => 0o077,
    };
    if !is_trusted_user(user, found.owner) {
        return Some(Weakness::Owner);
    }
    (found.mode & forbidden != 0).then_some(Weakness::Mode)
}

/// Returns true if a group has no members except this user and root, according to the texts of `/etc/passwd` and
/// `/etc/group`. Returns false for a group that `/etc/group` does not contain, because its members are unknown.
fn is_private_group(group: u32, user: u32, passwd: &str, groups: &str) -> bool {
    let users: Vec<(&str, Option<u32>, Option<u32>)> = passwd
        .lines()
        .map(|line| {
            let field = |index| line.split(':').nth(index);
            let number = |index| field(index).and_then(|text| text.parse().ok());
            (field(0).unwrap_or_default(), number(2), number(3))
        })
        .collect();
    let is_trusted = |number: Option<u32>| number.is_some_and(|number| is_trusted_user(user, number));
    let is_trusted_name = |name: &str| users.iter().any(|&(of, number, _)| of == name && is_trusted(number));
    let by_default =
        { users.iter() }.filter(|&&(_, _, own)| own == Some(group)).all(|&(_, number, _)| is_trusted(number));
    let line = groups.lines().find(|line| line.split(':').nth(2) == Some(&*group.to_string()));
    let members = line.map(|line| line.split(':').nth(3).unwrap_or_default());
    by_default && members.is_some_and(|names| names.split(',').filter(|name| !name.is_empty()).all(is_trusted_name))
}

/// Returns true if processes of `user` trust processes of the user `other`.
fn is_trusted_user(user: u32, other: u32) -> bool {
    other == user || other == ROOT
}

/// Returns true if this process trusts processes of the user `other`, which must be its own user or root.
pub fn trusts_user(other: u32) -> bool {
    is_trusted_user(geteuid().as_raw(), other)
}

/// Checks one file or folder. A symbolic link is checked by its owner only.
///
/// # Errors
/// [`OwnershipError`].
pub fn check_one(path: &Path, protection: Protection) -> Result<(), OwnershipError> {
    let unknown = |error| OwnershipError::Unknown { path: path.to_path_buf(), error };
    let found = fs::symlink_metadata(path).map_err(unknown)?;
    let (user, owner) = (geteuid().as_raw(), found.uid());
    let mode = if found.is_symlink() { 0 } else { found.mode() & PERMISSIONS };
    let read = |path| fs::read_to_string(path).unwrap_or_default();
    let has_private_group =
        mode & 0o020 != 0 && is_private_group(found.gid(), user, &read("/etc/passwd"), &read("/etc/group"));
    match weakness(user, Ownership { owner, mode, is_folder: found.is_dir(), has_private_group }, protection) {
        None => Ok(()),
        Some(Weakness::Owner) => Err(OwnershipError::Owner { path: path.to_path_buf(), owner, user }),
        Some(Weakness::Mode) => Err(OwnershipError::Mode { path: path.to_path_buf(), mode, protection }),
    }
}

/// Checks that no other user can change a file or folder, or put another one in its place: the file, all folders above
/// it, and those of the symbolic links on the way.
///
/// # Errors
/// [`OwnershipError`] with the first unsafe file or folder.
pub fn check_path(path: &Path) -> Result<(), OwnershipError> {
    check_links(path, MAX_LINKS)
}

fn check_links(path: &Path, links: usize) -> Result<(), OwnershipError> {
    let unknown = |path: &Path, error| OwnershipError::Unknown { path: path.to_path_buf(), error };
    let path = std::path::absolute(path).map_err(|error| unknown(path, error))?;
    let mut parts: Vec<&Path> = path.ancestors().collect();
    parts.reverse();
    for part in parts {
        check_one(part, Protection::Write)?;
        if let Ok(target) = fs::read_link(part) {
            let left = links
                .checked_sub(1)
                .ok_or_else(|| unknown(part, io::Error::other("the path has too many symbolic links")))?;
            check_links(&part.parent().unwrap_or(part).join(target), left)?;
        }
    }
    Ok(())
}

/// Checks that only this user and root can access a directory, and that no other user can move it.
///
/// # Errors
/// [`OwnershipError`] with the first file or directory that another user can access or change.
pub fn check_private(directory: &Path) -> Result<(), OwnershipError> {
    check_path(directory)?;
    let directory = directory.canonicalize().unwrap_or_else(|_| directory.to_path_buf());
    check_one(&directory, Protection::Access)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, chown, symlink};

    use super::*;

    #[test]
    fn files_of_the_user_and_of_root_that_others_cannot_write_are_safe() {
        use Protection::{Access as All, Write};
        let folder = true;
        for (user, owner, mode, is_folder, protection, expected) in [
            (1000, 1000, 0o644, false, Write, None),
            (1000, 0, 0o644, false, Write, None),
            (0, 0, 0o644, false, Write, None),
            (1000, 1001, 0o600, false, Write, Some(Weakness::Owner)),
            (0, 1000, 0o600, false, Write, Some(Weakness::Owner)),
            (1000, 1000, 0o664, false, Write, Some(Weakness::Mode)),
            (1000, 1000, 0o646, false, Write, Some(Weakness::Mode)),
            (1000, 0, 0o755, folder, Write, None),
            (1000, 1000, 0o775, folder, Write, Some(Weakness::Mode)),
            (1000, 0, 0o1777, folder, Write, None),
            (1000, 1001, 0o1777, folder, Write, Some(Weakness::Owner)),
            // The sticky bit protects nothing on a file.
            (1000, 1000, 0o1666, false, Write, Some(Weakness::Mode)),
            (1000, 1000, 0o700, folder, All, None),
            (1000, 1000, 0o600, false, All, None),
            (1000, 1001, 0o700, folder, All, Some(Weakness::Owner)),
            (1000, 1000, 0o710, folder, All, Some(Weakness::Mode)),
            (1000, 1000, 0o640, false, All, Some(Weakness::Mode)),
            (1000, 0, 0o1777, folder, All, Some(Weakness::Mode)),
        ] {
            let access = Ownership { owner, mode, is_folder, has_private_group: false };
            let found = weakness(user, access, protection);
            assert_eq!(found, expected, "user {user}, owner {owner}, mode {mode:o}, {protection:?}");
        }
        let of_group = |mode, protection| {
            weakness(1000, Ownership { owner: 1000, mode, is_folder: false, has_private_group: true }, protection)
        };
        assert_eq!(of_group(0o664, Write), None);
        assert_eq!(of_group(0o666, Write), Some(Weakness::Mode));
        assert_eq!(of_group(0o660, All), Some(Weakness::Mode));
    }

    #[test]
    fn a_private_group_has_no_other_members() {
        let passwd = "root:x:0:0::/root:/bin/sh\nann:x:1000:1000::/home/ann:/bin/sh\nbob:x:1001:1001::/home/bob:/bin/sh\n\
                      eve:x:1002:100::/home/eve:/bin/sh\n";
        let groups = "root:x:0:\nusers:x:100:\nann:x:1000:\nbob:x:1001:ann\nlab:x:50:ann,bob\nown:x:51:ann,root\nold:x:52:gone\n";
        let private: Vec<u32> = (0..2000).filter(|&group| is_private_group(group, 1000, passwd, groups)).collect();
        assert_eq!(private, [0, 51, 1000]);
        assert!(!is_private_group(1000, 1001, passwd, groups));
        assert!(!is_private_group(1000, 1000, passwd, ""));
    }

    #[test]
    fn folders_above_and_links_on_the_way_are_checked() {
        let root = tempfile::tempdir().unwrap();
        let root = root.path().canonicalize().unwrap();
        let set_mode = |name: &str, mode| fs::set_permissions(root.join(name), PermissionsExt::from_mode(mode));
        for folder in ["safe", "open", "open/inner"] {
            fs::create_dir(root.join(folder)).unwrap();
            set_mode(folder, 0o755).unwrap();
        }
        for file in ["safe/file", "open/inner/file"] {
            fs::write(root.join(file), "").unwrap();
            set_mode(file, 0o644).unwrap();
        }
        symlink(root.join("open/inner/file"), root.join("safe/link")).unwrap();
        symlink("loop", root.join("safe/loop")).unwrap();
        let check = |name: &str| check_path(&root.join(name)).map_err(|error| error.to_string());
        for name in ["safe/file", "open/inner/file", "safe/link"] {
            assert_eq!(check(name), Ok(()), "{name}");
        }
        set_mode("open", 0o777).unwrap();
        let expected = format!("{} has mode 0777", root.join("open").display());
        for name in ["open/inner/file", "safe/link"] {
            let found = check(name).unwrap_err();
            assert!(found.contains(&expected) && found.contains("`chmod go-w "), "{found}");
        }
        set_mode("open", 0o1777).unwrap();
        assert_eq!(check("open/inner/file"), Ok(()), "the sticky bit");
        assert!(check("safe/loop").unwrap_err().contains("the path has too many symbolic links"));
        assert!(check("safe/none").unwrap_err().contains("cannot read the owner"));
        if geteuid().is_root() {
            chown(root.join("open"), Some(12_345), None).unwrap();
            let found = check("safe/link").unwrap_err();
            assert!(found.contains("belongs to user 12345") && found.contains("runs as user 0"), "{found}");
        }
    }
}
