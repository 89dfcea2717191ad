#include "tests/streamer/fixture.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>

namespace splatvol::test {
namespace {

dvec3 random_point(std::mt19937& random, double low, double high) {
  std::uniform_real_distribution<double> uniform(low, high);
  return {uniform(random), uniform(random), uniform(random)};
}

View checked_view(const Camera& camera, int width, int height) {
  const auto view = make_view(camera, width, height);
  if (!view) throw std::runtime_error(view.error().message);
  return *view;
}

}  // namespace

TestVolume sample_volume(std::size_t points, std::uint32_t seed, TestVolumeOptions options) {
  std::vector<dvec3> positions = random_points(points, seed);
  std::vector<std::vector<double>> values(2);
  for (std::size_t i = 0; i < points; ++i) {
    const dvec3 p = positions[i];
    values[0].push_back(i % 17 == 3 ? std::numeric_limits<double>::quiet_NaN() : p.x + p.y + p.z);
    values[1].push_back(100 * p.z);
    positions[i] = options.cube.origin + options.cube.edge * p;
  }
  return make_test_volume(positions, values, options);
}

TransferFunction opaque() { return {0, 1, {{0, dvec3(1)}}, {{0, 1}}}; }

TransferFunction window(double low, double high) {
  const double margin = high - low;
  return {low - margin,
          high + margin,
          {{0, dvec3(1)}},
          {{0, 0}, {1.0 / 3, 0}, {1.0 / 3, 1}, {2.0 / 3, 1}, {2.0 / 3, 0}, {1, 0}}};
}

View view_from(const dvec3& eye, const dvec3& focal_point) {
  Camera camera{.position = eye, .focal_point = focal_point};
  return checked_view(camera, 256, 256);
}

View random_view(std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  Camera camera;
  camera.projection = uniform(random) < 0.3 ? Camera::Projection::orthographic : Camera::Projection::perspective;
  camera.position = uniform(random) < 0.3 ? random_point(random, 0, 1) : random_point(random, -1, 2);
  camera.focal_point = random_point(random, 0, 1);
  camera.up = random_point(random, -1, 1);
  camera.vertical_fov_degrees = 5 + 100 * uniform(random);
  camera.parallel_height = 0.05 + uniform(random);
  const int height = 64 + static_cast<int>(200 * uniform(random)), width = 64 + static_cast<int>(200 * uniform(random));
  return checked_view(camera, width, height);
}

View view_of_all(std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  Camera camera;
  camera.projection = uniform(random) < 0.5 ? Camera::Projection::orthographic : Camera::Projection::perspective;
  camera.focal_point = dvec3(0.5);
  const dvec3 direction = glm::normalize(random_point(random, -1, 1));
  camera.position = dvec3(0.5) + (5 + 20 * uniform(random)) * direction;
  camera.up = random_point(random, -1, 1);
  camera.vertical_fov_degrees = 100;
  camera.parallel_height = 6;
  return checked_view(camera, 200, 150);
}

std::vector<int> coverage(const TestVolume& volume, const Cut& cut) {
  std::vector<std::map<std::uint64_t, int>> drawn(volume.info.resolutions());
  for (const CutItem& item : cut.items)
    for (const PointRange& range : cut.ranges_of(item))
      for (std::uint64_t k = 0; k < range.count; ++k) ++drawn[item.resolution][range.begin + k];
  std::vector<int> result(volume.positions.size());
  for (std::size_t point = 0; point < result.size(); ++point)
    for (std::size_t r = 0; r < drawn.size(); ++r) {
      const auto found = drawn[r].find(volume.representatives[r][point]);
      if (found != drawn[r].end()) result[point] += found->second;
    }
  return result;
}

double mass_of(const TestVolume& volume) {
  double mass = 0;
  for (const auto& parcels : volume.parcels)
    for (const Parcel& parcel : parcels) mass += parcel.mass;
  return mass;
}

std::string kernel_name(const testing::TestParamInfo<KernelKind>& kernel) {
  return kernel.param == KernelKind::octant ? "octant" : "moments";
}

bool may_hide(const View& view, const Cube& a, const Cube& b) {
  constexpr double slack = 1e-12;
  for (int axis = 0; axis < 3; ++axis) {
    const double a_low = a.origin[axis], a_high = a_low + a.edge, b_low = b.origin[axis], b_high = b_low + b.edge;
    const double along = view.orthographic ? -view.forward[axis] : 0;  // towards the eye
    if (a_high <= b_low + slack && (view.orthographic ? along >= 0 : view.eye[axis] >= a_high)) return false;
    if (a_low >= b_high - slack && (view.orthographic ? along <= 0 : view.eye[axis] <= a_low)) return false;
  }
  return true;
}

std::vector<std::byte> bytes_of(const DrawList& list) {
  std::vector<std::byte> bytes;
  const auto append = [&](const auto& items) {
    const auto raw = std::as_bytes(std::span(items));
    bytes.insert(bytes.end(), raw.begin(), raw.end());
  };
  for (const DrawRange& range : list.ranges) {
    const RecordBlock& block = range.row.shapes->blocks()[range.block];
    append(std::array{block.origin.x, block.origin.y, block.origin.z, block.step, range.row.shapes->mass_scale(),
                      range.row.shapes->deviation_scale(), range.row.values->deviation_scale()});
    const auto append_range = [&](const auto& records) {
      append(std::span(records).subspan(range.begin, range.count));
    };
    std::visit(append_range, range.row.shapes->records());
    std::visit(append_range, range.row.values->records());
  }
  return bytes;
}

double mass_of(const DrawList& list) {
  double mass = 0;
  for (const DrawRange& range : list.ranges)
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) mass += unpack(range.row, i).mass;
  return mass;
}

Status TestSource::read(std::uint64_t offset, std::span<std::byte> out) {
  const std::scoped_lock lock(control_->mutex);
  ++control_->reads;
  control_->ranges.emplace_back(offset, offset + out.size());
  if (control_->failing) return fail(ErrorCode::io, "{}: the disk is gone", name_);
  SPLATVOL_TRY(check_range(*this, offset, out.size()));
  std::ranges::copy(std::span(bytes_).subspan(offset, out.size()), out.begin());
  return {};
}

std::unique_ptr<ByteSource> source_of(const TestVolume& volume, std::shared_ptr<TestSource::Control> control) {
  return std::make_unique<TestSource>(test_volume_bytes(volume), std::move(control));
}

}  // namespace splatvol::test
