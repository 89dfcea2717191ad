#include "builder/points/shared_tetrahedra.h"

#include <algorithm>
#include <utility>

#include "builder/sorting/external_sort.h"
#include "format/codec.h"

namespace splatvol {
namespace {

constexpr std::size_t passed_at_once = std::size_t{1} << 16;
constexpr std::size_t pending_memory = std::size_t{1} << 20;

// The number of subdomains that should find a tetrahedron stands in the lowest bits of its hash.
constexpr std::uint64_t owner_bits = 7;

std::uint64_t vote_for(const RankedTetrahedron& tetrahedron, std::size_t owners) {
  return (format::hash_bytes(std::as_bytes(std::span(tetrahedron.corners))) & ~owner_bits) | owners;
}

}  // namespace

SharedTetrahedra::SharedTetrahedra(std::vector<std::uint64_t> begins, const std::string& folder, TempFile votes,
                                   TakeTetrahedra take)
    : begins_(std::move(begins)),
      take_(std::move(take)),
      pending_(sizeof(RankedTetrahedron), pending_memory, folder),
      votes_(std::move(votes)),
      ballots_(begins_.size() - 1) {}

Result<std::unique_ptr<SharedTetrahedra>> SharedTetrahedra::create(std::vector<std::uint64_t> begins,
                                                                   const std::string& folder, TakeTetrahedra take) {
  SPLATVOL_TRY_ASSIGN(votes, TempFile::create(folder));
  return std::unique_ptr<SharedTetrahedra>(
      new SharedTetrahedra(std::move(begins), folder, std::move(votes), std::move(take)));
}

std::size_t SharedTetrahedra::subdomain_of(std::uint64_t rank) const {
  return static_cast<std::size_t>(std::ranges::upper_bound(begins_, rank) - begins_.begin()) - 1;
}

SharedTetrahedra::Owners SharedTetrahedra::owners_of(const RankedTetrahedron& tetrahedron) const {
  Owners owners;
  for (const std::uint64_t rank : tetrahedron.corners) {
    if (owners.count > 0 && rank < begins_[owners.subdomains[owners.count - 1] + 1]) continue;
    owners.subdomains[owners.count++] = subdomain_of(rank);
  }
  return owners;
}

Status SharedTetrahedra::pass_on(const RankedTetrahedron& tetrahedron) {
  passed_.push_back(tetrahedron);
  return passed_.size() < passed_at_once ? Status{} : flush();
}

Status SharedTetrahedra::flush() {
  if (!passed_.empty()) SPLATVOL_TRY(take_(passed_));
  passed_.clear();
  return {};
}

Status SharedTetrahedra::add(const FoundTetrahedra& found) {
  const std::size_t subdomain = certain_.size();
  certain_.push_back(found.is_certain);
  for (std::size_t t = 0; t < found.corners.size(); ++t) {
    RankedTetrahedron tetrahedron{.sign = found.signs[t]};
    for (std::size_t k = 0; k < 4; ++k) tetrahedron.corners[k] = found.ranks[found.corners[t][k]];
    if (tetrahedron.corners[0] >= begins_[subdomain] && tetrahedron.corners[3] < begins_[subdomain + 1]) {
      SPLATVOL_TRY(pass_on(tetrahedron));
      continue;
    }
    const Owners owners = owners_of(tetrahedron);
    const std::size_t first = owners.subdomains[0];
    const std::uint64_t vote = vote_for(tetrahedron, owners.count);
    new_votes_.emplace_back(first, vote);
    ballots_[first].balance += subdomain == first ? vote * (owners.count - 1) : ~vote + 1;
    const auto others = std::span(owners.subdomains).first(owners.count);
    const bool is_decided =
        std::ranges::any_of(others, [&](std::size_t owner) { return owner < subdomain && certain_[owner]; });
    if (is_decided) continue;
    if (found.is_certain) {
      SPLATVOL_TRY(pass_on(tetrahedron));
    } else if (subdomain == first) {
      SPLATVOL_TRY(pending_.append(std::as_bytes(std::span(&tetrahedron, 1))));
    }
  }
  return store_votes();
}

Status SharedTetrahedra::store_votes() {
  std::ranges::sort(new_votes_);
  std::vector<std::uint64_t> hashes;
  for (std::size_t begin = 0, end = 0; begin < new_votes_.size(); begin = end) {
    hashes.clear();
    const std::size_t ballot = new_votes_[begin].first;
    for (; end < new_votes_.size() && new_votes_[end].first == ballot; ++end) hashes.push_back(new_votes_[end].second);
    const auto bytes = std::as_bytes(std::span(hashes));
    ballots_[ballot].votes.push_back({votes_.size(), hashes.size(), format::hash_bytes(bytes)});
    SPLATVOL_TRY(votes_.append(bytes));
  }
  new_votes_.clear();
  return {};
}

// No subdomain before had them. If one behind is certain, it has passed on those that it has found.
Status SharedTetrahedra::decide_pending() {
  for (;;) {
    SPLATVOL_TRY_ASSIGN(records, pending_.next());
    if (records.empty()) return {};
    for (; !records.empty(); records = records.subspan(sizeof(RankedTetrahedron))) {
      const auto tetrahedron = record_at<RankedTetrahedron>(records, 0);
      const Owners owners = owners_of(tetrahedron);
      const auto all = std::span(owners.subdomains).first(owners.count);
      if (std::ranges::none_of(all, [&](std::size_t owner) { return certain_[owner]; }))
        SPLATVOL_TRY(pass_on(tetrahedron));
    }
  }
}

Result<std::uint64_t> SharedTetrahedra::count_disputed(const Ballot& ballot) const {
  std::vector<std::uint64_t> all;
  for (const Votes& votes : ballot.votes) {
    const std::size_t had = all.size();
    all.resize(had + votes.count);
    const auto bytes = std::as_writable_bytes(std::span(all).subspan(had));
    SPLATVOL_TRY(votes_.read(votes.offset, bytes));
    if (format::hash_bytes(bytes) != votes.hash) return fail_changed_temporary();
  }
  std::ranges::sort(all);
  std::uint64_t disputed = 0;
  for (std::size_t begin = 0, end = 0; begin < all.size(); begin = end) {
    for (end = begin + 1; end < all.size() && all[end] == all[begin];) ++end;
    if (end - begin < (all[begin] & owner_bits)) ++disputed;
  }
  return disputed;
}

Status SharedTetrahedra::finish() {
  SPLATVOL_TRY(decide_pending());
  SPLATVOL_TRY(flush());
  for (const Ballot& ballot : ballots_) {
    if (ballot.balance == 0) continue;
    SPLATVOL_TRY_ASSIGN(disputed, count_disputed(ballot));
    disputed_ += disputed;
  }
  ballots_ = {};
  return {};
}

}  // namespace splatvol
