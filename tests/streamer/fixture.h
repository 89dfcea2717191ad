// Volumes, views and transfer functions for the streamer's tests.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "scene/scene.h"
#include "streamer/splats/streamer.h"
#include "tests/support/long.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {

/// Makes a volume of random positions with the attributes a0 = x + y + z, some values missing, and a1 = 100 z.
[[nodiscard]] TestVolume sample_volume(std::size_t points, std::uint32_t seed, TestVolumeOptions options = {});

/// Extinction 1 for every value.
[[nodiscard]] TransferFunction opaque();

/// Extinction 1 within [low, high], and 0 beyond.
[[nodiscard]] TransferFunction window(double low, double high);

/// Returns a view of 256 x 256 pixels.
[[nodiscard]] View view_from(const dvec3& eye, const dvec3& focal_point = dvec3(0.5));

[[nodiscard]] inline Detail percent(double tolerance) { return {.tolerance_percent = tolerance}; }

/// Returns a camera in or near the unit cube, with the eye inside or outside, and either projection.
[[nodiscard]] View random_view(std::mt19937& random);

/// Returns a camera that sees the whole unit cube, and its splats.
[[nodiscard]] View view_of_all(std::mt19937& random);

/// Returns how many of the drawn splats stand for each point.
[[nodiscard]] std::vector<int> coverage(const TestVolume& volume, const Cut& cut);

/// Returns the mass of all material of a volume.
[[nodiscard]] double mass_of(const TestVolume& volume);

/// The kernels that tests take: the paper's, octant, only in long ones.
[[nodiscard]] inline std::vector<KernelKind> kernels() {
  return sample_of<KernelKind>({KernelKind::moments, KernelKind::octant});
}

/// Names of kernels in the names of tests.
[[nodiscard]] std::string kernel_name(const testing::TestParamInfo<KernelKind>& kernel);

/// Whether something in `a` may be in front of something in `b`, if no part of one is in the other.
[[nodiscard]] bool may_hide(const View& view, const Cube& a, const Cube& b);

/// Returns the bytes of a list's records in order, with their origins and scales, without ids.
[[nodiscard]] std::vector<std::byte> bytes_of(const DrawList& list);

/// Returns the sum of the masses of a list's splats. Requires the kernel moments.
[[nodiscard]] double mass_of(const DrawList& list);

/// A source in memory that records reads, and fails on demand. Thread-safe.
class TestSource final : public ByteSource {
 public:
  struct Control {
    std::mutex mutex;
    std::uint64_t reads = 0;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> ranges;  // [read]: from, up to
    bool failing = false;
    std::uint64_t cheap_gap = 1024;
  };
  TestSource(format::Bytes bytes, std::shared_ptr<Control> control)
      : bytes_(std::move(bytes)), control_(std::move(control)) {}
  [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return control_->cheap_gap; }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override;

 private:
  format::Bytes bytes_;
  std::shared_ptr<Control> control_;
  std::string name_ = "test.svol";
};

/// Makes a source of the volume's bytes.
[[nodiscard]] std::unique_ptr<ByteSource> source_of(
    const TestVolume& volume, std::shared_ptr<TestSource::Control> control = std::make_shared<TestSource::Control>());

}  // namespace splatvol::test
