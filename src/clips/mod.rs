//! CLIPS: documents as facts and facts as documents ([`facts`]), and a real CLIPS with the memory's
//! functions inside it (`engine`, feature `clips-engine`).

pub mod facts;

#[cfg(feature = "clips-engine")]
pub mod engine;
