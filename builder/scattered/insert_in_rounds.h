// Points into triangulations of CGAL, which look for no stop themselves.
#pragma once

#include <CGAL/Spatial_sort_traits_adapter_3.h>
#include <CGAL/property_map.h>
#include <CGAL/spatial_sort.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/interruption.h"

namespace splatvol {

/// Inserts points with their numbers. Fails with ErrorCode::cancelled if this thread's stop is requested: looks for one
/// before each round of 2^17 points, and tells `progress` the share that is inserted then; it may be empty. The points
/// of a round lie near each other, as in one insertion of all points.
template <class Triangulation>
[[nodiscard]] Status insert_in_rounds(std::vector<std::pair<typename Triangulation::Point, std::uint32_t>> points,
                                      Triangulation& triangulation, const std::function<void(double)>& progress = {}) {
  constexpr std::size_t round_points = std::size_t{1} << 17;
  using Position = CGAL::First_of_pair_property_map<std::pair<typename Triangulation::Point, std::uint32_t>>;
  using Traits = CGAL::Spatial_sort_traits_adapter_3<typename Triangulation::Geom_traits, Position>;
  if (points.size() > round_points)
    CGAL::spatial_sort<typename Triangulation::Concurrency_tag>(points.begin(), points.end(), Traits());
  for (std::size_t begin = 0; begin < points.size(); begin += round_points) {
    SPLATVOL_TRY(check_interruption());
    if (progress) progress(static_cast<double>(begin) / static_cast<double>(points.size()));
    const auto at = [&](std::size_t i) { return points.begin() + static_cast<std::ptrdiff_t>(i); };
    triangulation.insert(at(begin), at(std::min(points.size(), begin + round_points)));
  }
  return {};
}

}  // namespace splatvol
