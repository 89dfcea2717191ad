// One piece in use, the next one in the making.
#pragma once

#include <cstddef>
#include <functional>
#include <future>
#include <memory>
#include <utility>

#include "builder/sources/source.h"

namespace splatvol {

/// Makes pieces in order, each on a thread of its own while the one before it is in use. Not thread-safe. Destroyed, it
/// waits for the piece at hand: declare it last of what `make` uses.
class PieceAhead {
 public:
  /// Makes piece i of a source.
  using Make = std::function<Result<std::unique_ptr<Piece>>(std::size_t piece)>;

  PieceAhead(std::size_t count, Make make) : count_(count), make_(std::move(make)) {}

  /// Pieces in all.
  [[nodiscard]] std::size_t count() const { return count_; }

  /// Contract as Source::next().
  [[nodiscard]] Result<std::unique_ptr<Piece>> next() {
    if (next_ == 0) start();
    if (!coming_.valid()) return std::unique_ptr<Piece>();
    auto piece = coming_.get();
    start();
    return piece;
  }

 private:
  // Nothing is made before it is first asked for. Without a free thread, it is made when it is asked for.
  void start() {
    if (next_ < count_) coming_ = std::async(std::launch::async | std::launch::deferred, make_, next_++);
  }

  std::size_t count_;
  Make make_;
  std::size_t next_ = 0;
  std::future<Result<std::unique_ptr<Piece>>> coming_;
};

}  // namespace splatvol
