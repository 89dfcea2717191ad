#include "builder/output/index_leaf_spool.h"

#include <algorithm>
#include <span>
#include <tuple>

namespace splatvol {
namespace {

template <class Leaf>
auto members_of(Leaf& leaf) {
  return std::tie(leaf.key, leaf.depth, leaf.counts, leaf.splats, leaf.summaries);
}

}  // namespace

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
  leaf_.clear();
  leaf_.put_members(members_of(leaf));
  return spool_.append(leaf_.bytes());
}

Status IndexLeafSpool::read(std::size_t resolutions, const std::map<std::uint64_t, OpenIndexLeaf>& late,
                            const std::function<Status(IndexLeaf)>& visit) {
  std::uint64_t number = 0;
  return spool_.read([&](std::span<const std::byte> bytes) -> Status {
    for (ByteReader in(bytes); !in.at_end(); ++number) {
      OpenIndexLeaf leaf;
      in.get_members(members_of(leaf));
      if (const auto rest = late.find(number); rest != late.end()) leaf.include_late(rest->second);
      leaf.counts.resize(resolutions);
      leaf.splats.resize(resolutions);
      std::ranges::reverse(leaf.counts);
      std::ranges::reverse(leaf.splats);
      SPLATVOL_TRY(
          visit({leaf.key, leaf.depth, std::move(leaf.counts), std::move(leaf.splats), std::move(leaf.summaries)}));
    }
    return {};
  });
}

}  // namespace splatvol
