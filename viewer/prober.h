// Probes of the picture at rest, on a thread of their own.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "format/steps.h"
#include "player/session_host.h"
#include "streamer/streamer.h"
#include "viewer/probe.h"

namespace splatvol {

/// Answers one question at a time. Between questions about one frame, the frame's splats need not be looked at again.
class Prober {
 public:
  explicit Prober(SessionHost& host) : host_(host) {}

  struct Question {
    std::uint64_t serial = 0;  // FrameSplats::serial
    TransferFunction function;
    std::optional<TransferFunction> opacity_function;
    Looking looking;
    std::optional<double> opacity;  // as in ProbedFrame::probe

    [[nodiscard]] bool operator==(const Question&) const = default;
  };

  /// The cells of a frame's file, whose values the probe shows.
  struct CellsOf {
    format::Steps steps;
    std::size_t step = 0;
    std::string attribute;
  };

  /// Asks about a frame, unless this has been asked before. Copies the frame's list. An answer that is on its way comes
  /// first: then nothing is asked. If the cells cannot be opened, values are those of splats.
  void ask(const Question& question, const FrameSplats& frame, const DrawingUnits& units, const CellsOf& cells);

  /// Returns the answer to a question, null until it is there. The answer may be that the ray meets nothing.
  [[nodiscard]] const std::optional<Probe>* answer_to(const Question& question);

  /// Takes an answer that is there; false: there is none. Called in each frame.
  bool take_answer();

  /// Whether an answer has not been taken yet.
  [[nodiscard]] bool is_busy() const { return answer_.is_begun(); }

  /// Lets go of the frame's rows, unless an answer is on its way.
  void forget();

 private:
  struct Answer {
    std::shared_ptr<const ProbedFrame> frame;
    std::shared_ptr<const ProbedCells> cells;
    std::optional<Probe> probe;
  };

  SessionHost& host_;
  std::optional<Question> asked_;
  Task<Answer> answer_;
  std::optional<Question> answered_;
  std::optional<Probe> probe_;
  std::shared_ptr<const ProbedFrame> frame_;
  std::shared_ptr<const ProbedCells> cells_;  // of frame_; null: none
  std::uint64_t serial_ = 0;                  // of frame_
};

}  // namespace splatvol
