#include "base/part_table.h"

namespace splatvol {

PartTable::PartTable(MemoryBudget& budget) : budget_(budget) {
  budget_.set_yield([this] { return drop_oldest(); });
}

PartTable::~PartTable() { budget_.set_yield({}); }

bool PartTable::holds(const PartKey& key) const {
  const std::scoped_lock lock(mutex_);
  return slots_.contains(key);
}

std::shared_ptr<const void> PartTable::find_any(const PartKey& key) {
  auto holder = std::make_shared<Holder>(*this);
  const std::scoped_lock lock(mutex_);
  const auto found = slots_.find(key);
  return found == slots_.end() ? nullptr : hold(found->second, std::move(holder));
}

std::shared_ptr<const void> PartTable::insert_any(const PartKey& key, std::shared_ptr<const void> part,
                                                  Reservation reservation) {
  auto holder = std::make_shared<Holder>(*this);
  std::list<PartKey> place{key};
  const std::scoped_lock lock(mutex_);
  const auto [at, is_new] = slots_.try_emplace(key);
  Slot& slot = at->second;
  if (is_new) {
    slot.part = std::move(part);
    slot.reservation = std::move(reservation);
    slot.place = place.begin();
    spare_.splice(spare_.begin(), place);
    return hold(slot, std::move(holder));
  }
  reservation = Reservation();
  if (auto held = hold(slot, std::move(holder))) return held;
  return part;
}

// Requires the lock.
std::shared_ptr<const void> PartTable::hold(Slot& slot, std::shared_ptr<Holder> holder) {
  if (!slot.reservation.fasten()) return nullptr;
  if (slot.holders++ == 0) held_.splice(held_.begin(), spare_, slot.place);
  holder->slot = &slot;
  const void* const part = slot.part.get();
  return {std::move(holder), part};
}

void PartTable::let_go(Slot& slot) {
  const std::scoped_lock lock(mutex_);
  if (--slot.holders > 0) return;
  slot.reservation.loosen();
  spare_.splice(spare_.begin(), held_, slot.place);
}

void PartTable::clear(std::uint64_t file) {
  const std::scoped_lock lock(mutex_);
  for (auto slot = slots_.lower_bound({file, 0, 0}); slot != slots_.end() && slot->first.file == file;)
    if (slot->second.holders > 0) {
      ++slot;
    } else {
      spare_.erase(slot->second.place);
      slot = slots_.erase(slot);
    }
}

bool PartTable::drop_oldest() {
  const std::scoped_lock lock(mutex_);
  if (spare_.empty()) return false;
  slots_.erase(spare_.back());
  spare_.pop_back();
  return true;
}

PartTable::Turn::Turn(PartTable& table, const PartKey& key) : table_(table), key_(key) {
  {
    const std::scoped_lock lock(table.mutex_);
    auto& turn = table.turns_[key];
    if (!turn) turn = std::make_shared<std::mutex>();
    mutex_ = turn;
  }
  lock_ = std::unique_lock(*mutex_);
}

namespace {

// The parts of a file.
struct FileParts {
  PartTable& table;
  const std::uint64_t file;

  explicit FileParts(PartTable& of) : table(of), file(of.add_file()) {}
  FileParts(const FileParts&) = delete;
  FileParts& operator=(const FileParts&) = delete;
  ~FileParts() { table.clear(file); }
};

struct OwnParts {
  MemoryBudget budget;
  MemoryShare share;
  PartTable table;

  explicit OwnParts(std::uint64_t memory) : budget(memory), share(budget, memory), table(budget) {}
};

}  // namespace

PartRoom room_in(PartTable& table, MemoryShare& share) {
  const auto parts = std::make_shared<const FileParts>(table);
  return {&table, &share, parts->file, parts};
}

PartRoom own_room(std::uint64_t memory) {
  const auto own = std::make_shared<OwnParts>(memory);
  return {&own->table, &own->share, own->table.add_file(), own};
}

// The last one that knows the mutex, besides the table, removes it.
PartTable::Turn::~Turn() {
  lock_.unlock();
  const std::scoped_lock lock(table_.mutex_);
  if (mutex_.use_count() == 2) table_.turns_.erase(key_);
}

}  // namespace splatvol
