//! What happens to files, recorded; and a file system that forgets what was not synced.
//!
//! A power cut may leave more than was synced, in any order; [`Loss`] has the extremes. Names and contents are kept
//! apart as a disk keeps them: a file that was synced, but whose name was not, is gone; a name that was, but whose
//! content was not, is an empty file.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One thing that happened.
#[derive(Clone, Debug)]
pub(crate) enum Change {
    /// A folder was made.
    Folder(PathBuf),
    /// A file was made with this content.
    Write(PathBuf, Vec<u8>),
    /// Bytes were added to a file.
    Append(PathBuf, Vec<u8>),
    /// A file was cut to a length.
    Cut(PathBuf, usize),
    /// A file's content was synced.
    Sync(PathBuf),
    /// The names in a folder were synced.
    SyncFolder(PathBuf),
    /// A file or folder got another name.
    Rename(PathBuf, PathBuf),
    /// A file or folder was removed.
    Remove(PathBuf),
    /// So much was called done.
    Said(u64),
}

thread_local! {
    static JOURNAL: RefCell<Option<Vec<Change>>> = const { RefCell::new(None) };
}

/// Records a change, if this thread is being recorded.
#[expect(clippy::needless_pass_by_value, reason = "written where it happens, and kept")]
pub(crate) fn note(change: Change) {
    JOURNAL.with_borrow_mut(|journal| journal.iter_mut().for_each(|all| all.push(change.clone())));
}

/// What `work` changes on this thread.
pub(crate) fn recorded<R>(work: impl FnOnce() -> R) -> (R, Vec<Change>) {
    JOURNAL.set(Some(Vec::new()));
    let result = work();
    (result, JOURNAL.take().unwrap())
}

/// What a cut takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Loss {
    /// Nothing: a kill.
    Nothing,
    /// Contents that were not synced, while all names are kept.
    Contents,
    /// The second half of each content that was not synced.
    Halves,
    /// Contents and names that were not synced.
    Everything,
}

impl Loss {
    pub(crate) const ALL: [Self; 4] =
        [Self::Nothing, Self::Contents, Self::Halves, Self::Everything];
}

#[derive(Clone, Debug)]
enum Node {
    File { now: Vec<u8>, synced: Vec<u8> },
    Folder { now: BTreeMap<String, usize>, synced: BTreeMap<String, usize> },
}

/// The disk under a folder.
#[derive(Clone, Debug)]
pub(crate) struct Disk {
    root: PathBuf,
    nodes: Vec<Node>,
}

impl Disk {
    /// With nothing in `root`, which is there.
    pub(crate) fn new(root: &Path) -> Self {
        let folder = Node::Folder { now: BTreeMap::new(), synced: BTreeMap::new() };
        Self { root: root.to_owned(), nodes: vec![folder] }
    }

    /// Takes a change in.
    pub(crate) fn apply(&mut self, change: &Change) {
        match change {
            Change::Folder(path) => {
                // Those that were found, not made, may be known.
                if self.find(path).is_none() {
                    let folder = Node::Folder { now: BTreeMap::new(), synced: BTreeMap::new() };
                    self.put(path, folder);
                }
            }
            Change::Write(path, bytes) => {
                self.put(path, Node::File { now: bytes.clone(), synced: Vec::new() });
            }
            Change::Append(path, bytes) => {
                self.content(path).0.extend(bytes);
            }
            Change::Cut(path, length) => self.content(path).0.truncate(*length),
            Change::Sync(path) => {
                let (now, synced) = self.content(path);
                synced.clone_from(now);
            }
            Change::SyncFolder(path) => {
                // Of what is above the root nothing is known.
                let Some(id) = self.find(path) else { return };
                let Node::Folder { now, synced } = &mut self.nodes[id] else { panic!("a file") };
                synced.clone_from(now);
            }
            Change::Rename(from, to) => {
                let id = self.find(from).unwrap();
                self.names(from).remove(&last(from));
                self.names(to).insert(last(to), id);
            }
            Change::Remove(path) => {
                self.names(path).remove(&last(path));
            }
            Change::Said(_) => {}
        }
    }

    /// Makes the folder `place` what a cut leaves now. Equal answers stand for equal contents.
    pub(crate) fn restore(&self, place: &Path, loss: Loss) {
        std::fs::create_dir_all(place).unwrap();
        self.restore_node(0, place, loss);
    }

    /// All that a cut leaves now, to compare with another moment's.
    pub(crate) fn left(&self, loss: Loss) -> Vec<(PathBuf, Vec<u8>)> {
        let mut all = Vec::new();
        let mut pending = vec![(0, PathBuf::new())];
        while let Some((id, path)) = pending.pop() {
            match &self.nodes[id] {
                Node::Folder { now, synced } => {
                    let names = if loss == Loss::Everything { synced } else { now };
                    pending.extend(names.iter().map(|(name, &id)| (id, path.join(name))));
                    all.push((path, Vec::new()));
                }
                Node::File { now, synced } => all.push((path, remains(now, synced, loss))),
            }
        }
        all
    }

    fn restore_node(&self, id: usize, path: &Path, loss: Loss) {
        match &self.nodes[id] {
            Node::Folder { now, synced } => {
                std::fs::create_dir_all(path).unwrap();
                let names = if loss == Loss::Everything { synced } else { now };
                for (name, &id) in names {
                    self.restore_node(id, &path.join(name), loss);
                }
            }
            Node::File { now, synced } => {
                std::fs::write(path, remains(now, synced, loss)).unwrap();
            }
        }
    }

    fn find(&self, path: &Path) -> Option<usize> {
        let mut id = 0;
        for name in path.strip_prefix(&self.root).ok()? {
            let Node::Folder { now, .. } = &self.nodes[id] else { return None };
            id = *now.get(name.to_str().unwrap())?;
        }
        Some(id)
    }

    fn put(&mut self, path: &Path, node: Node) {
        self.nodes.push(node);
        let id = self.nodes.len() - 1;
        self.names(path).insert(last(path), id);
    }

    /// The names beside a path.
    fn names(&mut self, path: &Path) -> &mut BTreeMap<String, usize> {
        let id = self.find(path.parent().unwrap()).unwrap_or_else(|| panic!("{}", path.display()));
        let Node::Folder { now, .. } = &mut self.nodes[id] else { panic!("a file") };
        now
    }

    fn content(&mut self, path: &Path) -> (&mut Vec<u8>, &mut Vec<u8>) {
        let id = self.find(path).unwrap_or_else(|| panic!("{}", path.display()));
        let Node::File { now, synced } = &mut self.nodes[id] else { panic!("a folder") };
        (now, synced)
    }
}

fn last(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_owned()
}

fn remains(now: &[u8], synced: &[u8], loss: Loss) -> Vec<u8> {
    match loss {
        Loss::Nothing => now.to_owned(),
        Loss::Halves if now.starts_with(synced) => {
            now[..synced.len() + (now.len() - synced.len()) / 2].to_owned()
        }
        Loss::Halves | Loss::Contents | Loss::Everything => synced.to_owned(),
    }
}

#[test]
fn names_and_contents_are_forgotten_apart() {
    let root = Path::new("/r");
    let [a, b] = ["/r/a", "/r/b"].map(PathBuf::from);
    let mut disk = Disk::new(root);
    let left = |disk: &Disk, loss| {
        let mut left = disk.left(loss);
        left.remove(0);
        left
    };
    disk.apply(&Change::Write(a.clone(), b"1234".to_vec()));
    assert_eq!(left(&disk, Loss::Nothing), [("a".into(), b"1234".to_vec())]);
    assert_eq!(left(&disk, Loss::Halves), [("a".into(), b"12".to_vec())]);
    assert_eq!(left(&disk, Loss::Contents), [("a".into(), Vec::new())]);
    assert_eq!(left(&disk, Loss::Everything), []);
    disk.apply(&Change::Sync(a.clone()));
    assert_eq!(left(&disk, Loss::Everything), []);
    disk.apply(&Change::SyncFolder(root.to_owned()));
    disk.apply(&Change::Rename(a, b.clone()));
    assert_eq!(left(&disk, Loss::Contents), [("b".into(), b"1234".to_vec())]);
    assert_eq!(left(&disk, Loss::Everything), [("a".into(), b"1234".to_vec())]);
    disk.apply(&Change::SyncFolder(root.to_owned()));
    disk.apply(&Change::Append(b, b"5".to_vec()));
    assert_eq!(left(&disk, Loss::Everything), [("b".into(), b"1234".to_vec())]);
}
