// Makes the next piece while one is in use.
#pragma once

#include <cstddef>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// Makes pieces in order, each on a thread of its own while the one before it is in use. Not thread-safe. The
/// destructor waits for the piece that is being made: declare this member after all members that `make` uses.
class PieceAhead {
 public:
  /// Makes piece i of a source.
  using Make = std::function<Result<std::unique_ptr<Piece>>(std::size_t piece)>;

  PieceAhead(std::size_t count, Make make) : count_(count), make_(std::move(make)) {}

  /// Number of pieces.
  [[nodiscard]] std::size_t count() const { return count_; }

  /// Contract as Source::next().
  [[nodiscard]] Result<std::unique_ptr<Piece>> next() {
    if (!std::exchange(started_, true)) start();
    if (!coming_.valid()) return std::unique_ptr<Piece>();
    auto piece = coming_.get();
    last_ = coming_number_;
    start();
    return piece;
  }

  /// The number of the piece that next() returned last.
  [[nodiscard]] std::size_t last() const { return last_; }

  /// Contract as Source::select(): parts are pieces.
  void select(std::vector<std::uint64_t> pieces) { selected_ = std::move(pieces); }

 private:
  // The first piece is made when next() is first called. Without a free thread, each piece is made in its next().
  void start() {
    if (next_ >= (selected_ ? selected_->size() : count_)) return;
    coming_number_ = selected_ ? static_cast<std::size_t>((*selected_)[next_]) : next_;
    ++next_;
    coming_ = std::async(std::launch::async | std::launch::deferred, make_, coming_number_);
  }

  std::size_t count_;
  Make make_;
  std::optional<std::vector<std::uint64_t>> selected_;  // none: all
  std::size_t next_ = 0, coming_number_ = 0, last_ = 0;
  bool started_ = false;
  std::future<Result<std::unique_ptr<Piece>>> coming_;
};

}  // namespace splatvol
