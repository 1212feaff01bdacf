//! iceoryx2 with all its memory in files below one folder, instead of in `/dev/shm`, where every login may make files.
//!
//! The stock `ipc::Service` differs in this alone. It keeps one object for all users, of mode 0666, which any of them
//! may truncate; and a name there can be taken by whoever comes first. Below a folder of mode 0700 neither can happen.
//! The folder lies in memory (`/run`, `$XDG_RUNTIME_DIR`, `/dev/shm`), so that nothing reaches a disk; where a user
//! names another one, or another login took the name in `/dev/shm` and only the home folder is left (`place`), it may.

use core::fmt::Debug;

use iceoryx2::service::{Service, internal::ServiceInternal};
use iceoryx2::unique_id_generator::unique_system_id::UniqueSystemId;
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
use iceoryx2_bb_lock_free::mpmc::counting_bit_set::RelocatableCountingBitSet;
use iceoryx2_cal::arc_sync_policy::single_threaded::SingleThreaded;
use iceoryx2_cal::dynamic_storage::file::Storage;
use iceoryx2_cal::event::trigger::State;
use iceoryx2_cal::event::trigger::unix_datagram_socket::GenericUnixDatagramSocketTrigger;
use iceoryx2_cal::resizable_shared_memory::dynamic::DynamicMemory;
use iceoryx2_cal::shared_memory::file::Memory;
use iceoryx2_cal::shm_allocator::bump_allocator::BumpAllocator;
use iceoryx2_cal::shm_allocator::pool_allocator::PoolAllocator;
use iceoryx2_cal::zero_copy_connection::file::Connection;
use iceoryx2_cal::{bag, hash, monitoring, reactor, serialize, static_storage};

/// The kind of iceoryx2 service that edgecap's streams are.
#[derive(Debug, Clone)]
pub(crate) struct FileService;

impl Service for FileService {
    type StaticStorage = static_storage::recommended::Ipc;
    type ConfigSerializer = serialize::recommended::Recommended;
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = Storage<T>;
    type Bag = bag::recommended::Recommended;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = Storage<T>;
    type ServiceNameHasher = hash::recommended::Recommended;
    type SharedMemory = Memory<PoolAllocator>;
    type ResizableSharedMemory = DynamicMemory<PoolAllocator, Memory<PoolAllocator>>;
    type Connection = Connection;
    type Event = GenericUnixDatagramSocketTrigger<
        RelocatableCountingBitSet,
        Storage<State<RelocatableCountingBitSet, ()>>,
    >;
    type Monitoring = monitoring::recommended::Ipc;
    type Reactor = reactor::recommended::Ipc;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> = SingleThreaded<T>;
    type BlackboardMgmt<K: Send + Sync + Debug + ZeroCopySend + 'static> = Storage<K>;
    type BlackboardPayload = Memory<BumpAllocator>;
    type UniqueId = UniqueSystemId;
}

impl ServiceInternal<Self> for FileService {}
