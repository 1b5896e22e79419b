//! The page that shows a body, as HTML.

use growbot_pictures::view::{NamedScene, Subject, page};
use growbot_scene::scene_file::LoadedScene;
use pyo3::prelude::*;

use crate::error::{Error, ErrorKind};
use crate::scene::through;

/// Returns an HTML page that shows a body and the scene of its plan. The page has no scene if the scene's files are
/// missing or have changed.
pub fn page_of(py: Python<'_>, subject: &Subject) -> Result<String, Error> {
    py.detach(|| {
        let scene = match subject.run {
            Some(run) => run.scene(subject.plan, subject.robot, None).ok().flatten(),
            None => through(subject.plan).ok().flatten().map(|scene| LoadedScene::clone(&scene.loaded)),
        };
        let file = subject.plan.scene.as_ref().map_or("", |scene| &scene.file);
        let scene = scene.as_ref().map(|loaded| NamedScene { file, scene: &loaded.scene });
        page::render(&Subject { scene, ..*subject })
    })
    .map_err(|error| Error::new(ErrorKind::Input, error))
}

/// Returns an `iframe` element that contains an HTML page, for display in a notebook.
pub fn framed(page: &str) -> String {
    let page = page.replace('&', "&amp;").replace('"', "&quot;");
    format!(
        "<iframe sandbox=\"allow-scripts\" srcdoc=\"{page}\" width=\"100%\" height=\"520\" style=\"border:0\"></iframe>"
    )
}
