//! The documents of a partition in their order: in memory while they are few, else in a temporary file.

use std::cell::RefCell;
use std::rc::Rc;

use bson::RawDocumentBuf;

use super::member::Member;
use super::order::Order;
use crate::query::error::Result;
use crate::query::limit::{ALLOCATION, memory};
use crate::query::spill::{BlockWriter, Blocks, Spill};

/// The most bytes of documents that are read at a time, unless one needs more.
const BLOCK: usize = 32 << 10;

/// Several documents that follow each other.
type Block = Vec<Rc<Member>>;

/// The documents of a partition, which can be read by their number.
pub(super) struct Partition<'a> {
    order: &'a Order,
    length: usize,
    /// The number of the first document of each block.
    firsts: Vec<usize>,
    /// Blocks that are in memory.
    cache: RefCell<Cache>,
    /// The file, and where each block is in it.
    file: Option<(Blocks, Vec<u64>)>,
}

/// Collects the documents of a partition.
pub(super) struct Builder<'a, 'b> {
    order: &'a Order,
    spill: &'b Spill,
    length: usize,
    firsts: Vec<usize>,
    blocks: Vec<Rc<Block>>,
    held: usize,
    last: Block,
    last_bytes: usize,
    file: Option<(BlockWriter, Vec<u64>)>,
}

impl<'a, 'b> Builder<'a, 'b> {
    pub(super) fn new(order: &'a Order, spill: &'b Spill) -> Self {
        Self {
            order,
            spill,
            length: 0,
            firsts: Vec::new(),
            blocks: Vec::new(),
            held: 0,
            last: Vec::new(),
            last_bytes: 0,
            file: None,
        }
    }

    pub(super) fn push(&mut self, member: Member) -> Result<()> {
        if self.last.is_empty() {
            self.firsts.push(self.length);
        }
        self.length += 1;
        self.last_bytes += bytes(&member);
        self.last.push(Rc::new(member));
        if self.last_bytes < BLOCK.min(limit(self.spill) / 8) { Ok(()) } else { self.end_block() }
    }

    fn end_block(&mut self) -> Result<()> {
        let block = std::mem::take(&mut self.last);
        self.held += std::mem::take(&mut self.last_bytes);
        self.blocks.push(Rc::new(block));
        if self.file.is_none() && self.held <= limit(self.spill) {
            return Ok(());
        }
        let (mut writer, mut places) = match self.file.take() {
            Some(file) => file,
            None => (BlockWriter::new(&self.spill.folder)?, Vec::new()),
        };
        for block in self.blocks.drain(..) {
            places.push(writer.push(&written(&block))?);
        }
        self.file = Some((writer, places));
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<Partition<'a>> {
        if !self.last.is_empty() {
            self.end_block()?;
        }
        let file = match self.file.take() {
            Some((writer, places)) => Some((writer.finish()?, places)),
            None => None,
        };
        let mut cache = Cache { limit: limit(self.spill), ..Cache::default() };
        if file.is_none() {
            cache.blocks = self.blocks.into_iter().map(|block| Some(Cached { block, used: 0, bytes: 0 })).collect();
        } else {
            cache.blocks.resize_with(self.firsts.len(), || None);
        }
        Ok(Partition { order: self.order, length: self.length, firsts: self.firsts, cache: RefCell::new(cache), file })
    }
}

impl Partition<'_> {
    pub(super) fn len(&self) -> usize {
        self.length
    }

    /// Returns a document by its number; none beyond the end.
    pub(super) fn get(&self, index: usize) -> Result<Option<Rc<Member>>> {
        if index >= self.length {
            return Ok(None);
        }
        let number = self.firsts.partition_point(|first| *first <= index).saturating_sub(1);
        let first = self.firsts.get(number).copied().unwrap_or_default();
        Ok(self.block(number)?.get(index - first).cloned())
    }

    fn block(&self, number: usize) -> Result<Rc<Block>> {
        let mut cache = self.cache.borrow_mut();
        if let Some(block) = cache.get(number) {
            return Ok(block);
        }
        let place = self.file.as_ref().and_then(|(file, places)| Some((file, *places.get(number)?)));
        let Some((file, place)) = place else { return Ok(Rc::default()) };
        let block = Rc::new(read(&file.read(place)?, self.order)?);
        cache.put(number, Rc::clone(&block));
        Ok(block)
    }
}

/// Blocks in memory: those that were not used for longest make room for others.
#[derive(Default)]
struct Cache {
    limit: usize,
    blocks: Vec<Option<Cached>>,
    /// The numbers of the blocks that can be read again.
    held: Vec<usize>,
    bytes: usize,
    clock: u64,
}

struct Cached {
    block: Rc<Block>,
    used: u64,
    bytes: usize,
}

impl Cache {
    fn get(&mut self, number: usize) -> Option<Rc<Block>> {
        let cached = self.blocks.get_mut(number)?.as_mut()?;
        self.clock += 1;
        cached.used = self.clock;
        Some(Rc::clone(&cached.block))
    }

    fn put(&mut self, number: usize, block: Rc<Block>) {
        self.clock += 1;
        let cached = Cached { bytes: block.iter().map(|member| bytes(member)).sum(), used: self.clock, block };
        self.bytes += cached.bytes;
        if let Some(slot) = self.blocks.get_mut(number) {
            *slot = Some(cached);
            self.held.push(number);
        }
        while self.bytes > self.limit && self.held.len() > 1 {
            self.drop_oldest();
        }
    }

    fn drop_oldest(&mut self) {
        let used = |number: &usize| self.blocks.get(*number).and_then(Option::as_ref).map(|cached| cached.used);
        let oldest = (0..self.held.len()).min_by_key(|place| self.held.get(*place).and_then(used));
        let Some(number) = oldest.map(|place| self.held.swap_remove(place)) else { return };
        let dropped = self.blocks.get_mut(number).and_then(Option::take);
        self.bytes -= dropped.map_or(0, |cached| cached.bytes);
    }
}

/// Returns the bytes that a partition may hold; the sort before it needs as much for what it merges.
fn limit(spill: &Spill) -> usize {
    spill.limit / 4
}

/// Returns the memory that a document needs.
fn bytes(member: &Member) -> usize {
    let at = member.at.as_ref().map_or(0, |at| memory(at).unwrap_or_default());
    size_of::<Member>() + 3 * ALLOCATION + member.place.len() + member.document.as_bytes().len() + at
}

/// Returns the bytes of a block: of each document its place, with its length in front, and itself.
fn written(block: &Block) -> Vec<u8> {
    let mut bytes = Vec::new();
    for member in block {
        bytes.extend((member.place.len() as u64).to_le_bytes());
        bytes.extend(&member.place);
        bytes.extend(member.document.as_bytes());
    }
    bytes
}

/// Reads what [`written`] gave.
fn read(mut bytes: &[u8], order: &Order) -> Result<Block> {
    let mut block = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk() {
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX).min(rest.len());
        let (place, rest) = rest.split_at(length);
        let length = rest.first_chunk().map_or(0, |length| u32::from_le_bytes(*length));
        let (document, rest) = rest.split_at(usize::try_from(length).unwrap_or(usize::MAX).min(rest.len()));
        let document = RawDocumentBuf::from_bytes(document.to_vec())?;
        block.push(Rc::new(Member::new(document, place.to_vec(), order)));
        bytes = rest;
    }
    Ok(block)
}
