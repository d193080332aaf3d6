//! What is in an HDF5 file: every dataset and link, also of those that cannot be opened.

use hdf5_reader::btree_v1::collect_btree_v1_leaves_storage;
use hdf5_reader::btree_v2::{BTreeV2Header, BTreeV2Record, collect_btree_v2_records_storage};
use hdf5_reader::error::Error as H5Error;
use hdf5_reader::fractal_heap::FractalHeap;
use hdf5_reader::group::Group;
use hdf5_reader::io::Cursor;
use hdf5_reader::local_heap::LocalHeap;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::link::{self, LinkMessage, LinkTarget};
use hdf5_reader::messages::link_info::LinkInfoMessage;
use hdf5_reader::messages::symbol_table_msg::SymbolTableMessage;
use hdf5_reader::symbol_table::SymbolTableNode;
use hdf5_reader::{Dataset, Hdf5File, Storage};
use std::collections::HashSet;

/// Groups in groups beyond this are not looked into.
const MAX_DEPTH: u32 = 16;
/// More objects than this are not looked at.
const MAX_OBJECTS: usize = 10_000;

/// What a name in a file stands for.
pub(crate) enum Item {
    Dataset(Box<Dataset>),
    /// What cannot be opened, and why.
    Broken(H5Error),
    /// An object of another file, by its path there.
    External {
        file: String,
        path: String,
    },
    /// A soft link to nothing.
    Dangling(String),
}

/// The datasets of a file and what else has a name in it, groups left out.
#[derive(Default)]
pub(crate) struct Tree {
    pub(crate) items: Vec<(String, Item)>,
    /// More than could be looked at.
    pub(crate) cut: bool,
    seen: HashSet<u64>,
}

impl Tree {
    pub(crate) fn of(file: &Hdf5File) -> Result<Tree, H5Error> {
        let mut tree = Tree::default();
        tree.group(file, &file.root_group()?, "", 0)?;
        tree.items.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(tree)
    }

    /// The name of the dataset at an address.
    pub(crate) fn name_at(&self, address: u64) -> Option<(&str, &Dataset)> {
        self.items.iter().find_map(|(name, item)| match item {
            Item::Dataset(d) if d.address() == address => Some((name.as_str(), &**d)),
            _ => None,
        })
    }

    fn group(
        &mut self,
        file: &Hdf5File,
        group: &Group,
        name: &str,
        depth: u32,
    ) -> Result<(), H5Error> {
        if depth > MAX_DEPTH || !self.seen.insert(group.address()) {
            return Ok(());
        }
        for link in links(file, group)? {
            if self.items.len() >= MAX_OBJECTS {
                self.cut = true;
                break;
            }
            let path = format!("{name}/{}", link.name);
            match link.target {
                LinkTarget::External { filename, path: of } => {
                    let item = Item::External {
                        file: filename,
                        path: of,
                    };
                    self.items.push((path, item));
                }
                LinkTarget::Hard { .. } => self.child(file, group, &link.name, path, depth),
                LinkTarget::Soft { path: of } => match group.dataset(&link.name) {
                    Err(H5Error::DatasetNotFound(_)) if group.group(&link.name).is_err() => {
                        self.items.push((path, Item::Dangling(of)));
                    }
                    _ => self.child(file, group, &link.name, path, depth),
                },
            }
        }
        Ok(())
    }

    fn child(&mut self, file: &Hdf5File, group: &Group, name: &str, path: String, depth: u32) {
        let error = match group.dataset(name) {
            Ok(dataset) => {
                // the same dataset by another name is the same volume
                if self.seen.insert(dataset.address()) {
                    self.items.push((path, Item::Dataset(Box::new(dataset))));
                }
                return;
            }
            // a group, or a type with a name
            Err(H5Error::DatasetNotFound(_)) => match group.group(name) {
                Ok(group) => self.group(file, &group, &path, depth + 1).err(),
                Err(_) => None,
            },
            Err(error) => Some(error),
        };
        if let Some(error) = error {
            self.items.push((path, Item::Broken(error)));
        }
    }
}

/// The links of a group. The library lists a group only if each of its members can be opened.
fn links(file: &Hdf5File, group: &Group) -> Result<Vec<LinkMessage>, H5Error> {
    let header = file.get_or_parse_header(group.address())?;
    let mut found = Vec::new();
    for message in &header.messages {
        match message {
            HdfMessage::Link(link) => found.push(link.clone()),
            HdfMessage::LinkInfo(info) => found.extend(dense(group, info)?),
            HdfMessage::SymbolTable(table) => found.extend(old(group, table)?),
            _ => {}
        }
    }
    Ok(found)
}

/// Links of a group that has many.
fn dense(group: &Group, info: &LinkInfoMessage) -> Result<Vec<LinkMessage>, H5Error> {
    let (storage, offset, length) = (group.storage(), group.offset_size(), group.length_size());
    if Cursor::is_undefined_offset(info.fractal_heap_address, offset) {
        return Ok(Vec::new());
    }
    let heap = FractalHeap::parse_at_storage(storage, info.fractal_heap_address, offset, length)?;
    let index = info.btree_name_index_address;
    let header = BTreeV2Header::parse_at_storage(storage, index, offset, length)?;
    let records =
        collect_btree_v2_records_storage(storage, &header, offset, length, None, &[], None)?;
    let mut found = Vec::new();
    for record in records {
        let BTreeV2Record::LinkNameHash { heap_id, .. } = record else {
            continue;
        };
        let bytes = heap.get_object_storage(&heap_id, storage, offset, length)?;
        found.push(link::parse(
            &mut Cursor::new(&bytes),
            offset,
            length,
            bytes.len(),
        )?);
    }
    Ok(found)
}

/// Links of a group of the older form.
fn old(group: &Group, table: &SymbolTableMessage) -> Result<Vec<LinkMessage>, H5Error> {
    let (storage, offset, length) = (group.storage(), group.offset_size(), group.length_size());
    let heap = LocalHeap::parse_at_storage(storage, table.heap_address, offset, length)?;
    let leaves = collect_btree_v1_leaves_storage(
        storage,
        table.btree_address,
        offset,
        length,
        None,
        &[],
        None,
    )?;
    let entry = 2 * usize::from(offset) + 24;
    let mut found = Vec::new();
    for (_, address) in leaves {
        let head = read(storage, address, 8)?;
        let count = usize::from(u16::from_le_bytes([head[6], head[7]]));
        let bytes = read(storage, address, 8 + count * entry)?;
        let node = SymbolTableNode::parse(&mut Cursor::new(&bytes), offset, length)?;
        for entry in node.entries {
            let at = u32::from_le_bytes(*entry.scratch.first_chunk().unwrap_or(&[0; 4]));
            let target = match entry.cache_type {
                2 => LinkTarget::Soft {
                    path: heap.get_string_storage(at.into(), storage)?,
                },
                _ => LinkTarget::Hard {
                    address: entry.object_header_address,
                },
            };
            found.push(LinkMessage {
                name: heap.get_string_storage(entry.link_name_offset, storage)?,
                target,
                creation_order: None,
            });
        }
    }
    Ok(found)
}

fn read(storage: &dyn Storage, address: u64, len: usize) -> Result<Vec<u8>, H5Error> {
    let bytes = storage.read_range(address, len)?;
    if bytes.len() < len {
        return Err(H5Error::InvalidData("a table of links cut short".into()));
    }
    Ok(bytes.as_ref().to_vec())
}
