// How far a build is, as a whole.
#pragma once

#include <cstddef>
#include <mutex>
#include <optional>
#include <string>

namespace splatvol {

/// The share of a build that is done, and the time that is left. Thread-safe.
class BuildShare {
 public:
  BuildShare();

  /// A series has so many steps; a build of one step needs no call.
  void set_steps(std::size_t steps);
  /// Step number `step` is opened.
  void open_step(std::size_t step);

  /// The reader process has read this share of the bytes of its inputs.
  void read(double share);

  /// Contract as BuildProgress (builder/pipeline/build.h).
  void update(const std::string& stage, double fraction);

  struct State {
    std::string stage;
    double share = 0;                         // of the whole build; never falls
    std::optional<double> seconds_left = {};  // none: nobody knows yet
  };
  [[nodiscard]] State state() const;

 private:
  void raise_share();

  mutable std::mutex mutex_;
  std::string stage_ = "reading";
  double start_;
  double share_ = 0;
  double bytes_ = 0;         // read, of the bytes of the inputs
  bool has_reader_ = false;  // that tells of them
  double fraction_ = 0;      // of the stage
  std::size_t place_ = 0;    // of the stage, among all stages
  // Steps of a series come in groups, and each group has all stages. The present one ends at `group_end_`.
  std::size_t steps_ = 1, opened_ = 1, done_ = 0, group_end_ = 1;
};

}  // namespace splatvol
