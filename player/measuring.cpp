#include "player/measuring.h"

#include <algorithm>
#include <thread>

#include "sampler/integrals.h"
#include "sampler/surface_integrals.h"

namespace splatvol {
namespace {

constexpr double still_seconds = 0.3;  // after which contours are measured

Result<Measured> measure(const format::Steps& steps, const MeasureRequest& request, std::uint64_t memory,
                         const std::function<void(double)>& progress) {
  const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(request.step));
  if (std::holds_alternative<std::monostate>(request.surface)) {
    SPLATVOL_TRY_ASSIGN(integrals, integrate_cells(*volume, request.integrals, memory, threads, progress));
    return Measured(std::move(integrals));
  }
  SurfaceRequest of{.surface = {}, .integrals = request.integrals, .vector = request.vector};
  if (const auto* const contour = std::get_if<ContourSurface>(&request.surface)) of.surface = *contour;
  if (const auto* const slice = std::get_if<HalfSpace>(&request.surface)) of.surface = *slice;
  SPLATVOL_TRY_ASSIGN(integrals, integrate_surface(*volume, of, memory, threads, progress));
  return Measured(std::move(integrals));
}

}  // namespace

IntegralRequest region_of(const Scene& scene) {
  IntegralRequest region{.box = scene.clip_box};
  for (const SceneClipPlane& plane : scene.clip_planes)
    if (plane.active) region.clip_planes.push_back({plane.point, plane.normal});
  return region;
}

void Measuring::begin(SessionHost& host, const format::Steps& steps, const MeasureRequest& request,
                      std::uint64_t memory) {
  end();
  request_ = request;
  share_ = std::make_shared<std::atomic<double>>(0);
  const auto work = [steps, request, memory, share = share_] {
    return measure(steps, request, memory, [&](double done) { *share = done; });
  };
  task_ = {host, work, SessionHost::Priority::low};
}

std::optional<Result<Measured>> Measuring::take() {
  if (!task_.is_begun() || !task_.wait()) return std::nullopt;
  return task_.take();
}

// Sizes are forgotten with their contours.
void ContourMeasures::note_scene(const Scene& scene, std::size_t step, double seconds, bool is_held) {
  std::vector<double> values;
  for (const Contour& contour : contours_of(scene).surfaces) values.push_back(contour.value);
  const std::pair of(scene.attribute, step);
  const bool has_changed = of != of_ || values != values_;
  still_seconds_ = has_changed || is_held ? 0 : still_seconds_ + seconds;
  if (!has_changed) return;
  if (of != of_) sizes_.clear();
  of_ = of;
  values_ = std::move(values);
  std::erase_if(sizes_, [&](const auto& known) { return !std::ranges::binary_search(values_, known.first); });
  if (measuring_.is_begun() && !is_wanted(measuring_.request())) measuring_.interrupt();
}

bool ContourMeasures::is_wanted(const MeasureRequest& request) const {
  const auto& contour = std::get<ContourSurface>(request.surface);
  return std::pair(contour.attribute, request.step) == of_ && std::ranges::binary_search(values_, contour.value);
}

Status ContourMeasures::take_size() {
  const auto result = measuring_.take();
  const bool is_cancelled = result && !*result && result->error().code == ErrorCode::cancelled;
  if (!result || is_cancelled || !is_wanted(measuring_.request())) return {};
  std::optional<Size>& size = sizes_[std::get<ContourSurface>(measuring_.request().surface).value];
  if (!*result) return tl::unexpected(result->error());
  const auto& integrals = std::get<SurfaceIntegrals>(**result);
  size = {integrals.area, integrals.enclosed_volume};
  return {};
}

Status ContourMeasures::update(SessionHost& host, const format::Steps& steps, std::size_t step, const Scene& scene,
                               std::uint64_t memory, double seconds, bool is_held) {
  note_scene(scene, step, seconds, is_held);
  const Status taken = take_size();
  const std::optional<double> next = next_unknown();
  is_pending_ = next.has_value();
  if (next && !measuring_.is_begun() && still_seconds_ >= still_seconds)
    measuring_.begin(host, steps,
                     {.step = step,
                      .surface = ContourSurface{scene.attribute, *next},
                      .integrals = {.attributes = {scene.attribute}}},
                     memory);
  return taken;
}

std::optional<double> ContourMeasures::next_unknown() const {
  const auto next = std::ranges::find_if(values_, [&](double value) { return !sizes_.contains(value); });
  return next == values_.end() ? std::nullopt : std::optional(*next);
}

std::optional<ContourMeasures::Size> ContourMeasures::size_of(double value) const {
  const auto known = sizes_.find(value);
  return known == sizes_.end() ? std::nullopt : known->second;
}

void ContourMeasures::reset() {
  measuring_.end();
  sizes_.clear();
  of_ = {};
  values_.clear();
  still_seconds_ = 0;
  is_pending_ = false;
}

}  // namespace splatvol
