#include "streamer/default_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <tuple>

#include "scene/color_maps.h"

namespace splatvol {
namespace {

constexpr std::uint64_t enough_points = 20000;  // to know where the data is
constexpr double share_left_out = 0.01;    // of the values, at either end, so that outliers do not flatten the rest
constexpr double share_of_densest = 0.05;  // of the largest extinction; above it a point counts as visible
constexpr std::size_t fewest_visible = 50;
constexpr double margin = 0.92;  // share of the image that the data may fill
const dvec3 from_data_to_eye = glm::normalize(dvec3(0.5, 0.4, 0.8));

// Optical depth of a ray through all of the data, at the value that is farthest from the most frequent one.
constexpr double largest_optical_depth = 6;

struct Samples {
  std::vector<dvec3> positions;
  std::vector<float> stored;  // of the attribute
};

Status append_group(const format::Volume& volume, std::uint64_t group_index, int attribute, Samples& samples) {
  const format::Group group = volume.rows().group(group_index);
  const std::uint64_t row = volume.rows().row(group.segment, group_index);
  const auto read = [&](format::ColumnKind kind, int of_attribute, auto unpack, auto& all) -> Status {
    const int column = volume.info().find_column(kind, of_attribute);
    if (column < 0) return fail(ErrorCode::invalid_data, "{}: lacks a column that a scene needs", volume.name());
    SPLATVOL_TRY_ASSIGN(page, volume.read_directory_page(volume.directory_page_of_row(row, column)));
    const format::ChunkLocation& location = volume.find_chunk(page, row, column);
    SPLATVOL_TRY_ASSIGN(packed, volume.read_bytes(location.offset, location.entry.packed_bytes));
    all.resize(all.size() + group.count);
    return unpack(location.entry, packed, std::span(all).last(group.count), volume.name());
  };
  SPLATVOL_TRY(read(format::ColumnKind::position, -1, &format::unpack_positions, samples.positions));
  return read(format::ColumnKind::value, attribute, &format::unpack_values, samples.stored);
}

// Reads the points of the finest resolution with few enough points.
Result<Samples> read_samples(const format::Volume& volume, int attribute) {
  const auto& counts = volume.info().resolution_counts;
  const auto finer = std::ranges::upper_bound(counts, enough_points);
  const std::uint64_t wanted = finer == counts.begin() ? counts[0] : *(finer - 1);
  Samples samples;
  for (std::uint64_t group = 0; samples.positions.size() < wanted; ++group)
    SPLATVOL_TRY(append_group(volume, group, attribute, samples));
  return samples;
}

// Returns the points that the camera should show: those that are not clear, or all if hardly any point is visible.
std::vector<dvec3> find_visible(const Samples& samples, const TransferFunction& function, double offset) {
  double densest = 0;
  for (const auto& density : function.densities) densest = std::max(densest, density.extinction);
  std::vector<dvec3> visible;
  for (std::size_t i = 0; i < samples.positions.size(); ++i)
    if (function.extinction(offset + samples.stored[i]) > share_of_densest * densest)
      visible.push_back(samples.positions[i]);
  return visible.size() < fewest_visible ? samples.positions : visible;
}

Box bounds(const std::vector<dvec3>& points) {
  Box box{points[0], points[0]};
  for (const dvec3& p : points) box = {glm::min(box.low, p), glm::max(box.high, p)};
  return box;
}

// Each point needs a distance of the camera at which it is in the image. The largest distance suits all points.
Camera fit_camera(const std::vector<dvec3>& points, const Box& box, double edge) {
  Camera camera;
  camera.focal_point = 0.5 * (box.low + box.high);
  const dvec3 right = glm::normalize(glm::cross(camera.up, from_data_to_eye));
  const dvec3 up = glm::cross(from_data_to_eye, right);
  const double slope = margin * std::tan(camera.vertical_fov_degrees * std::numbers::pi / 360);
  double distance = 0;
  for (const dvec3& p : points) {
    const dvec3 d = p - camera.focal_point;
    const double aside = std::max(std::abs(glm::dot(d, right)), std::abs(glm::dot(d, up)));
    distance = std::max(distance, aside / slope + glm::dot(d, from_data_to_eye));
  }
  if (!(distance > 0)) distance = 0.5 * edge / slope;
  camera.position = camera.focal_point + distance * from_data_to_eye;
  return camera;
}

// Returns how long a ray through the middle of the box is inside it; at least a sixteenth of the longest side.
double typical_chord(const Box& box, double edge) {
  const dvec3 extent = box.high - box.low;
  const double longest = std::max({extent.x, extent.y, extent.z});
  if (!(longest > 0)) return edge;
  double chord = longest;
  for (int axis = 0; axis < 3; ++axis) chord = std::min(chord, extent[axis] / from_data_to_eye[axis]);
  return std::max(chord, longest / 16);
}

// Returns the value below which `share` of the counted values are, by interpolation in the bins.
double percentile(const format::Attribute& attribute, const std::array<std::uint64_t, 64>& histogram, double share) {
  const double wanted =
      share * static_cast<double>(std::accumulate(histogram.begin(), histogram.end(), std::uint64_t{0}));
  double below = 0;
  std::size_t bin = 0;
  for (; bin < 63 && below + static_cast<double>(histogram[bin]) < wanted; ++bin)
    below += static_cast<double>(histogram[bin]);
  const double inside = histogram[bin] == 0 ? 0 : (wanted - below) / static_cast<double>(histogram[bin]);
  return attribute.min + (attribute.max - attribute.min) * (static_cast<double>(bin) + inside) / 64;
}

std::pair<double, double> choose_domain(const format::Attribute& attribute, const format::Histograms& histograms,
                                        std::size_t index) {
  double low = attribute.min, high = attribute.max;
  if (!histograms.empty()) {
    low = percentile(attribute, histograms[index], share_left_out);
    high = percentile(attribute, histograms[index], 1 - share_left_out);
  }
  // A constant value gets a narrow domain round it.
  const double narrowest = std::max(1e-6 * std::max(std::abs(low), std::abs(high)), 1e-30);
  if (!(high - low > narrowest)) return {low - narrowest, high + narrowest};
  return {low, high};
}

// Chooses densities for a ray of length 1. The most frequent values are usually those of the surroundings: their bin is
// clear, and other values are denser the farther they are from it.
std::vector<TransferFunction::Density> choose_densities(const format::Attribute& attribute,
                                                        const format::Histograms& histograms, std::size_t index,
                                                        const TransferFunction& function) {
  if (!(attribute.max > attribute.min)) return {{0, largest_optical_depth}};
  if (histograms.empty()) return {{0, 0}, {1, largest_optical_depth}};
  const auto bin = static_cast<double>(std::ranges::max_element(histograms[index]) - histograms[index].begin());
  const auto parameter = [&](double b) {
    const double value = attribute.min + (attribute.max - attribute.min) * b / 64;
    return std::clamp((value - function.lo) / (function.hi - function.lo), 0.0, 1.0);
  };
  const double below = parameter(bin), above = parameter(bin + 1);
  const double farthest = std::max(below, 1 - above);
  if (!(farthest > 0)) return {{0, largest_optical_depth}};
  const double slope = largest_optical_depth / farthest;
  return {{0, slope * below}, {below, 0}, {above, 0}, {1, slope * (1 - above)}};
}

Result<int> choose_attribute(const format::Volume& volume, const std::string& name) {
  const auto& attributes = volume.info().attributes;
  if (attributes.empty()) return fail(ErrorCode::invalid_data, "{}: has no attributes", volume.name());
  const std::string& chosen = name.empty() ? attributes.front().name : name;
  SPLATVOL_TRY_ASSIGN(index, format::find_attribute(volume.info(), chosen, volume.name()));
  const auto& attribute = attributes[static_cast<std::size_t>(index)];
  if (std::isnan(attribute.min))
    return fail(ErrorCode::invalid_data, "{}: '{}' has no values", volume.name(), attribute.name);
  return index;
}

}  // namespace

Result<Scene> default_scene(const format::Volume& volume, const std::string& attribute) {
  SPLATVOL_TRY_ASSIGN(index, choose_attribute(volume, attribute));
  SPLATVOL_TRY_ASSIGN(samples, read_samples(volume, index));
  SPLATVOL_TRY_ASSIGN(histograms, volume.read_histograms());
  const auto a = static_cast<std::size_t>(index);
  const format::Attribute& chosen = volume.info().attributes[a];

  Scene scene;
  scene.attribute = chosen.name;
  TransferFunction& function = scene.transfer_function;
  std::tie(function.lo, function.hi) = choose_domain(chosen, histograms, a);
  function.colors = short_cool_to_warm();
  function.densities = choose_densities(chosen, histograms, a, function);

  const std::vector<dvec3> points = find_visible(samples, function, chosen.offset);
  const Box box = bounds(points);
  const double edge = volume.info().cube.edge;
  scene.camera = fit_camera(points, box, edge);
  for (auto& density : function.densities) density.extinction /= typical_chord(box, edge);
  return scene;
}

}  // namespace splatvol
