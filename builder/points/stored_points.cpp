#include "builder/points/stored_points.h"

#include <algorithm>
#include <optional>
#include <span>
#include <utility>

#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

PointBatch empty_batch(std::size_t attributes) {
  PointBatch batch;
  batch.values.resize(attributes);
  return batch;
}

void erase_front(PointBatch& batch, std::size_t count) {
  const auto erase = [&](auto& items) {
    items.erase(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(count));
  };
  erase(batch.keys);
  erase(batch.positions);
  for (auto& values : batch.values) erase(values);
}

}  // namespace

Result<StoredPoints> StoredPoints::create(PointStream& stream, const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder));
  StoredPoints stored(stream.layout(), std::move(file));
  const PointRecords& layout = stored.layout_;
  // Small leaves keep what is read in vain low; their number is bounded.
  const std::size_t most = std::max<std::size_t>(32, stream.count() >> 19);
  PointBatch held = empty_batch(layout.attributes());
  std::vector<std::byte> records;
  std::optional<MortonKey> last_key;
  std::optional<dvec3> last_position;
  std::size_t count = 0;
  for (bool ended = false; !ended;) {
    SPLATVOL_TRY_ASSIGN(more, stream.next(held));
    ended = !more;
    std::size_t begin = 0;
    while (ended ? begin < held.size() : begin + most < held.size()) {
      const auto keys = std::span<const MortonKey>(held.keys).subspan(begin);
      const int shared = last_key ? common_depth(*last_key, keys[0]) : -1;
      const int depth = leaf_depth(shared, keys[0], most < keys.size() ? &keys[most] : nullptr);
      const auto within = keys.first(std::min(most, keys.size()));
      const auto past = std::ranges::partition_point(
          within, [&](const MortonKey& key) { return common_depth(keys[0], key) >= depth; });
      const std::size_t end = begin + static_cast<std::size_t>(past - within.begin());
      Node leaf{{}, 0, count, count + end - begin};
      stored.shared_.push_back(static_cast<std::int8_t>(shared));
      stored.continues_.push_back(last_position == held.positions[begin]);
      for (std::size_t i = begin; i < end; ++i) {
        if (last_position != held.positions[i]) leaf.box.include({held.positions[i], held.positions[i]});
        last_position = held.positions[i];
      }
      last_key = held.keys[end - 1];
      stored.nodes_.push_back(leaf);
      count = leaf.end;
      begin = end;
    }
    records.resize(begin * layout.bytes());
    for (std::size_t i = 0; i < begin; ++i) {
      std::byte* record = records.data() + i * layout.bytes();
      layout.set_position(record, held.positions[i]);
      for (std::size_t a = 0; a < layout.attributes(); ++a) layout.set_value(record, a, held.values[a][i]);
    }
    SPLATVOL_TRY(stored.file_.append(records));
    erase_front(held, begin);
  }
  stored.build_tree();
  return stored;
}

void StoredPoints::build_tree() {
  leaves_ = nodes_.size();
  constexpr std::size_t children = 8;
  for (std::size_t begin = 0, end = nodes_.size(); end - begin > 1; begin = std::exchange(end, nodes_.size())) {
    for (std::size_t first = begin; first < end; first += children) {
      Node node{{}, 0, first, std::min(first + children, end)};
      for (std::size_t child = node.begin; child < node.end; ++child) {
        node.box.include(nodes_[child].box);
        nodes_[child].parent = nodes_.size();
      }
      nodes_.push_back(node);
    }
  }
  nodes_.back().parent = nodes_.size() - 1;
}

std::vector<std::size_t> StoredPoints::cut(std::size_t block_points) const {
  std::vector<std::size_t> cuts{0};
  for (std::size_t begin = 0; begin < leaves_; begin = cuts.back()) {
    const std::size_t first = nodes_[begin].begin;
    std::size_t best = begin + 1;
    for (std::size_t end = begin + 1; nodes_[end - 1].end - first <= block_points; ++end) {
      // Behind the last leaf ends every cell. In the first half of a block a cut would make for small ones.
      const bool late = nodes_[end - 1].end - first > block_points / 2;
      if (end == leaves_) {
        best = end;
        break;
      }
      if (!late || nodes_[best - 1].end - first <= block_points / 2 || shared_[end] <= shared_[best]) best = end;
    }
    cuts.push_back(best);
  }
  return cuts;
}

Status StoredPoints::read(std::size_t begin, std::size_t end, std::vector<std::byte>& records) const {
  const std::size_t before = records.size();
  records.resize(before + (end - begin) * layout_.bytes());
  return file_.read(begin * layout_.bytes(), std::span(records).subspan(before));
}

}  // namespace splatvol
