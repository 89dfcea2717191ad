#include "streamer/fade.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>

namespace splatvol {
namespace {

// An item of a cut.
struct Entry {
  const Cut* cut;
  std::uint32_t item;
  FadingCut::Role role;

  const CutItem& get() const { return cut->items[item]; }
  std::span<const PointRange> ranges() const { return cut->ranges_of(get()); }
  std::uint64_t splats() const {
    std::uint64_t sum = 0;
    for (const PointRange& range : ranges()) sum += range.count;
    return sum;
  }
};
using Entries = std::vector<Entry>;

// The entries in a cube. No two of `shown` overlap, and no two of `coming`.
struct Region {
  Entries shown;    // the last cut, once its fades have ended
  Entries leaving;  // what the last cut shows besides
  Entries coming;   // the next cut
};

std::uint64_t splats_of(const Entries& entries) {
  std::uint64_t sum = 0;
  for (const Entry& entry : entries) sum += entry.splats();
  return sum;
}

// Whether the entries are one node, which has this cube. Nodes have half of the edge of their parent, so the edge
// tells.
bool is_node(const Entries& entries, const Cube& cube) {
  return !entries.empty() && entries.front().get().cube.edge == cube.edge;
}

Cube child_of(const Cube& cube, unsigned octant) {
  const double edge = 0.5 * cube.edge;
  return {cube.origin + edge * dvec3(octant & 1, octant >> 1 & 1, octant >> 2), edge};
}

// Whether all of a cube appears in the picture.
bool is_inside(const View& view, const Cube& cube) {
  for (unsigned corner = 0; corner < 8; ++corner) {
    const dvec3 p = view.to_view(cube.origin + cube.edge * dvec3(corner & 1, corner >> 1 & 1, corner >> 2));
    const double scale = view.orthographic ? view.focal : view.focal / p.z;
    if (!(p.z > 0 && std::abs(p.x) * scale <= 0.5 * view.width && std::abs(p.y) * scale <= 0.5 * view.height))
      return false;
  }
  return true;
}

class Fader {
 public:
  Fader(const Cube& root, const View& view, const FadingCut& last, const Cut& next, Residency& residency,
        const FadeOptions& options)
      : root_(root), view_(view), last_(last), next_(next), residency_(residency), options_(options) {}

  FadingCut run() {
    Region all;
    for (std::uint32_t i = 0; i < last_.cut.items.size(); ++i) {
      FadingCut::Role role = last_.roles.empty() ? FadingCut::Role() : last_.roles[i];
      const bool over = role.fade != FadingCut::no_fade && weight_now(last_.fades[role.fade]) >= 1;
      if (over && role.leaving) continue;
      if (over) role = {};
      (role.leaving ? all.leaving : all.shown).push_back({&last_.cut, i, role});
    }
    for (std::uint32_t i = 0; i < next_.items.size(); ++i) all.coming.push_back({&next_, i, {}});
    fades_now_.assign(last_.fades.size(), FadingCut::no_fade);
    visit(root_, std::move(all));
    return std::move(now_);
  }

 private:
  // The factor makes up for rounding, which could cost another frame.
  double weight_now(const Fade& fade) const { return fade.weight + options_.change * (1 + 1e-9); }

  void visit(const Cube& cube, Region region) {
    if (region.coming.empty()) return;  // out of view
    if (region.shown.empty()) return draw(cube, std::move(region.coming));
    if (is_node(region.shown, cube) || is_node(region.coming, cube) || fades(region, cube)) return draw(cube, region);
    auto shown = split(cube, region.shown);
    auto leaving = split(cube, region.leaving);
    auto coming = split(cube, region.coming);
    const unsigned nearest = nearest_octant(view_, cube);
    for (unsigned i = 8; i-- > 0;) {
      const unsigned octant = i ^ nearest;
      visit(child_of(cube, octant), {std::move(shown[octant]), std::move(leaving[octant]), std::move(coming[octant])});
    }
  }

  bool fades(const Region& region, const Cube& cube) const {
    return !region.leaving.empty() && last_.fades[region.leaving.front().role.fade].cube.edge == cube.edge;
  }

  // Draws a region in which one of the two cuts has one node.
  void draw(const Cube& cube, Region& region) {
    const bool fading = !region.leaving.empty();
    const bool same = is_node(region.shown, cube) && is_node(region.coming, cube) &&
                      region.shown.front().get().resolution == region.coming.front().get().resolution;
    if (!fading && same) return draw(cube, std::move(region.coming));

    Entries uncovered;
    const bool covered = cover(cube, region.shown, region.coming, uncovered);
    const std::uint64_t splats = splats_of(region.leaving) + splats_of(region.shown) + splats_of(uncovered);
    const std::uint64_t besides = splats - std::min(splats, fading ? splats_of(region.coming) : 0);
    if (!covered || besides > options_.most_splats - besides_ || !is_there(region.shown) || !is_there(region.leaving))
      return draw(cube, std::move(region.coming));
    besides_ += besides;

    Entries entries;
    if (fading) {
      for (Entry& entry : region.leaving) entries.push_back(go_on(entry));
      for (Entry& entry : region.shown) entries.push_back(go_on(entry));
      const FadingCut::Role role{entries.front().role.fade, false};
      for (const Entry& entry : uncovered) entries.push_back({entry.cut, entry.item, role});
    } else {
      const auto fade = static_cast<std::uint32_t>(now_.fades.size());
      now_.fades.push_back({cube, std::min(options_.change, 1.0)});
      for (Entry& entry : region.shown) entries.push_back({entry.cut, entry.item, {fade, true}});
      for (Entry& entry : region.coming) entries.push_back({entry.cut, entry.item, {fade, false}});
    }
    draw(cube, std::move(entries));
  }

  bool is_there(const Entries& entries) {
    return std::ranges::all_of(entries, [&](const Entry& entry) { return residency_.holds(entry.ranges()); });
  }

  Entry go_on(Entry entry) {
    if (entry.role.fade == FadingCut::no_fade) return entry;
    std::uint32_t& fade = fades_now_[entry.role.fade];
    if (fade == FadingCut::no_fade) {
      const Fade& last = last_.fades[entry.role.fade];
      fade = static_cast<std::uint32_t>(now_.fades.size());
      now_.fades.push_back({last.cube, weight_now(last)});
    }
    entry.role.fade = fade;
    return entry;
  }

  // Adds the entries of `coming` that have come into view, so that `shown` does not have them. Returns false if only a
  // part of a node has come into view.
  bool cover(const Cube& cube, const Entries& shown, const Entries& coming, Entries& uncovered) const {
    if (coming.empty() || is_node(shown, cube)) return true;
    if (shown.empty()) {
      uncovered.insert(uncovered.end(), coming.begin(), coming.end());
      return true;
    }
    if (is_node(coming, cube)) return is_inside(last_.view, cube);
    const auto of_shown = split(cube, shown);
    const auto of_coming = split(cube, coming);
    for (unsigned octant = 0; octant < 8; ++octant)
      if (!cover(child_of(cube, octant), of_shown[octant], of_coming[octant], uncovered)) return false;
    return true;
  }

  // Appends entries back to front; a node comes before nodes inside it.
  void draw(const Cube& cube, Entries entries) {
    const auto within =
        std::ranges::stable_partition(entries, [&](const Entry& entry) { return entry.get().cube.edge == cube.edge; });
    for (const Entry& entry : std::ranges::subrange(entries.begin(), within.begin())) append(entry);
    if (within.empty()) return;
    auto octants = split(cube, {within.begin(), within.end()});
    const unsigned nearest = nearest_octant(view_, cube);
    for (unsigned i = 8; i-- > 0;)
      if (!octants[i ^ nearest].empty()) draw(child_of(cube, i ^ nearest), std::move(octants[i ^ nearest]));
  }

  void append(const Entry& entry) {
    CutItem item = entry.get();
    item.first_range = now_.cut.ranges.size();
    now_.cut.items.push_back(item);
    std::ranges::copy(entry.ranges(), std::back_inserter(now_.cut.ranges));
    now_.cut.splats += entry.splats();
    now_.roles.push_back(entry.role);
  }

  // Splits entries by octant. Requires that their cubes are smaller than `cube`.
  static std::array<Entries, 8> split(const Cube& cube, const Entries& entries) {
    std::array<Entries, 8> octants;
    const dvec3 middle = cube.origin + 0.5 * cube.edge;
    for (const Entry& entry : entries) {
      const dvec3& origin = entry.get().cube.origin;
      octants[(origin.x >= middle.x ? 1u : 0u) | (origin.y >= middle.y ? 2u : 0u) | (origin.z >= middle.z ? 4u : 0u)]
          .push_back(entry);
    }
    return octants;
  }

  const Cube& root_;
  const View& view_;
  const FadingCut& last_;
  const Cut& next_;
  Residency& residency_;
  const FadeOptions& options_;
  FadingCut now_;
  std::vector<std::uint32_t> fades_now_;  // [fade of the last cut]
  std::uint64_t besides_ = 0;             // splats besides those of the next cut
};

}  // namespace

float FadingCut::weight_of(std::size_t item) const {
  if (roles.empty() || roles[item].fade == no_fade) return 1;
  const double weight = fades[roles[item].fade].weight;
  return static_cast<float>(roles[item].leaving ? 1 - weight : weight);
}

FadingCut fade(const Cube& root, const View& view, const FadingCut& last, Cut next, Residency& residency,
               const FadeOptions& options) {
  const bool steady = last.fades.empty() && last.cut == next;
  if (options.change < 1 && !last.cut.items.empty() && !steady) {
    FadingCut now = Fader(root, view, last, next, residency, options).run();
    now.view = view;
    now.cut.complete = next.complete;
    if (!now.fades.empty()) return now;
  }
  return {view, std::move(next), {}, {}};
}

}  // namespace splatvol
