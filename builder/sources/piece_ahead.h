// Makes the next piece while one is in use.
#pragma once

#include <cstddef>
#include <functional>
#include <future>
#include <memory>
#include <utility>

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
    last_ = next_ - stride_;
    start();
    return piece;
  }

  /// The number of the piece that next() returned last.
  [[nodiscard]] std::size_t last() const { return last_; }

  /// Contract as Source::select_every(), for single pieces.
  void select_every(std::size_t first, std::size_t stride) {
    next_ = first;
    stride_ = stride;
  }

 private:
  // The first piece is made when next() is first called. Without a free thread, each piece is made in its next().
  void start() {
    if (next_ >= count_) return;
    coming_ = std::async(std::launch::async | std::launch::deferred, make_, next_);
    next_ += stride_;
  }

  std::size_t count_;
  Make make_;
  std::size_t next_ = 0, stride_ = 1, last_ = 0;
  bool started_ = false;
  std::future<Result<std::unique_ptr<Piece>>> coming_;
};

}  // namespace splatvol
