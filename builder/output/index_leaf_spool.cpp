#include "builder/output/index_leaf_spool.h"

#include <algorithm>
#include <cstring>
#include <span>

namespace splatvol {
namespace {

constexpr std::size_t buffer_bytes = std::size_t{1} << 20;

struct IndexLeafHead {
  MortonKey key;
  std::uint64_t depth, counts, splats, summaries;
};

template <class T>
void append_all(format::Bytes& bytes, const std::vector<T>& items) {
  const auto raw = std::as_bytes(std::span(items));
  bytes.insert(bytes.end(), raw.begin(), raw.end());
}

}  // namespace

// Reads a spool's blocks, and gives back the disk space of those that it has read.
class IndexLeafSpool::Reader {
 public:
  Reader(TempFile& file, std::span<const Block> blocks) : file_(file), blocks_(blocks) {}

  template <class T>
  Status read(std::span<T> out) {
    auto raw = std::as_writable_bytes(out);
    while (!raw.empty()) {
      if (at_ == buffer_.size()) SPLATVOL_TRY(refill());
      const std::size_t count = std::min(raw.size(), buffer_.size() - at_);
      std::memcpy(raw.data(), buffer_.data() + at_, count);
      raw = raw.subspan(count);
      at_ += count;
    }
    return {};
  }

  template <class T>
  Status read(std::vector<T>& items, std::uint64_t count) {
    items.resize(count);
    return read(std::span(items));
  }

 private:
  Status refill() {
    if (blocks_.empty()) return fail(ErrorCode::invalid_argument, "leaves: past the end");
    buffer_.resize(blocks_.front().bytes);
    SPLATVOL_TRY(file_.read(offset_, buffer_));
    if (format::hash_bytes(buffer_) != blocks_.front().hash) return fail_changed_temporary();
    blocks_ = blocks_.subspan(1);
    file_.release(offset_, buffer_.size());
    offset_ += buffer_.size();
    at_ = 0;
    return {};
  }

  TempFile& file_;
  std::span<const Block> blocks_;  // not read yet
  format::Bytes buffer_;
  std::size_t at_ = 0;
  std::uint64_t offset_ = 0;
};

SplatBounds& OpenIndexLeaf::splats_at(std::size_t level) {
  if (splats.size() <= level) splats.resize(level + 1);
  return splats[level];
}

void OpenIndexLeaf::count(std::size_t level, std::uint64_t points) {
  if (counts.size() <= level) counts.resize(level + 1);
  counts[level] += points;
}

void OpenIndexLeaf::include_late(const OpenIndexLeaf& other) {
  for (std::size_t s = 0; s < other.counts.size(); ++s) count(s, other.counts[s]);
  for (std::size_t s = 0; s < other.splats.size(); ++s) splats_at(s).include(other.splats[s]);
}

void OpenIndexLeaf::include(const OpenIndexLeaf& other) {
  include_late(other);
  for (std::size_t a = 0; a < summaries.size(); ++a) summaries[a].include(other.summaries[a]);
}

Status IndexLeafSpool::append(const OpenIndexLeaf& leaf) {
  format::append_record(buffer_, IndexLeafHead{leaf.key, static_cast<std::uint64_t>(leaf.depth), leaf.counts.size(),
                                               leaf.splats.size(), leaf.summaries.size()});
  append_all(buffer_, leaf.counts);
  append_all(buffer_, leaf.splats);
  append_all(buffer_, leaf.summaries);
  ++count_;
  return buffer_.size() < buffer_bytes ? Status{} : flush();
}

Status IndexLeafSpool::flush() {
  SPLATVOL_TRY(file_.append(buffer_));
  blocks_.push_back({buffer_.size(), format::hash_bytes(buffer_)});
  buffer_.clear();
  return {};
}

Status IndexLeafSpool::read(std::size_t resolutions, const std::map<std::uint64_t, OpenIndexLeaf>& late,
                            const std::function<Status(IndexLeaf)>& visit) {
  SPLATVOL_TRY(flush());
  Reader reader(file_, blocks_);
  for (std::uint64_t number = 0; number < count_; ++number) {
    IndexLeafHead head;
    SPLATVOL_TRY(reader.read(std::span(&head, 1)));
    OpenIndexLeaf leaf{head.key, static_cast<int>(head.depth), {}, {}, {}};
    SPLATVOL_TRY(reader.read(leaf.counts, head.counts));
    SPLATVOL_TRY(reader.read(leaf.splats, head.splats));
    SPLATVOL_TRY(reader.read(leaf.summaries, head.summaries));
    if (const auto rest = late.find(number); rest != late.end()) leaf.include_late(rest->second);
    leaf.counts.resize(resolutions);
    leaf.splats.resize(resolutions);
    std::ranges::reverse(leaf.counts);
    std::ranges::reverse(leaf.splats);
    SPLATVOL_TRY(
        visit({leaf.key, leaf.depth, std::move(leaf.counts), std::move(leaf.splats), std::move(leaf.summaries)}));
  }
  count_ = 0;
  blocks_.clear();
  return {};
}

}  // namespace splatvol
