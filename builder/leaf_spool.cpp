#include "builder/leaf_spool.h"

#include <algorithm>
#include <cstring>
#include <span>

namespace splatvol {
namespace {

constexpr std::size_t block_bytes = std::size_t{1} << 20;

struct LeafHead {
  MortonKey key;
  std::uint64_t depth, counts, splats, summaries;
};

template <class T>
void append_all(format::Bytes& bytes, const std::vector<T>& items) {
  const auto raw = std::as_bytes(std::span(items));
  bytes.insert(bytes.end(), raw.begin(), raw.end());
}

// Reads a file front to back, and gives back the room of what it has read.
class Reader {
 public:
  explicit Reader(TempFile& file) : file_(file) {}

  template <class T>
  Status read(std::span<T> out) {
    auto raw = std::as_writable_bytes(out);
    while (!raw.empty()) {
      if (at_ == block_.size()) SPLATVOL_TRY(next_block());
      const std::size_t count = std::min(raw.size(), block_.size() - at_);
      std::memcpy(raw.data(), block_.data() + at_, count);
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
  Status next_block() {
    block_.resize(std::min<std::uint64_t>(block_bytes, file_.size() - offset_));
    SPLATVOL_TRY(file_.read(offset_, block_));
    file_.release(offset_, block_.size());
    offset_ += block_.size();
    at_ = 0;
    return block_.empty() ? Status(fail(ErrorCode::invalid_argument, "leaves: past the end")) : Status{};
  }

  TempFile& file_;
  format::Bytes block_;
  std::size_t at_ = 0;
  std::uint64_t offset_ = 0;
};

}  // namespace

Status LeafSpool::append(const OpenLeaf& leaf) {
  format::append_record(buffer_, LeafHead{leaf.key, static_cast<std::uint64_t>(leaf.depth), leaf.counts.size(),
                                          leaf.splats.size(), leaf.summaries.size()});
  append_all(buffer_, leaf.counts);
  append_all(buffer_, leaf.splats);
  append_all(buffer_, leaf.summaries);
  ++count_;
  return buffer_.size() < block_bytes ? Status{} : flush();
}

Status LeafSpool::flush() {
  SPLATVOL_TRY(file_.append(buffer_));
  buffer_.clear();
  return {};
}

Status LeafSpool::read(std::size_t resolutions, const std::map<std::uint64_t, OpenLeaf>& late,
                       const std::function<Status(IndexLeaf)>& visit) {
  SPLATVOL_TRY(flush());
  Reader reader(file_);
  for (std::uint64_t number = 0; number < count_; ++number) {
    LeafHead head;
    SPLATVOL_TRY(reader.read(std::span(&head, 1)));
    OpenLeaf leaf{head.key, static_cast<int>(head.depth), {}, {}, {}};
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
  return {};
}

}  // namespace splatvol
