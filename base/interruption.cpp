#include "base/interruption.h"

#include <algorithm>
#include <thread>
#include <utility>

namespace splatvol {
namespace {

thread_local std::stop_token current_stop;

}  // namespace

Interruptible::Interruptible(std::stop_token stop) : before_(std::exchange(current_stop, std::move(stop))) {}

Interruptible::~Interruptible() { current_stop = std::move(before_); }

bool is_interrupted() { return current_stop.stop_requested(); }

Status check_interruption() { return is_interrupted() ? fail(ErrorCode::cancelled, "cancelled") : Status{}; }

std::stop_token stop_of_thread() { return current_stop; }

void sleep_interruptibly(std::chrono::milliseconds time) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point end = Clock::now() + time;
  for (auto now = Clock::now(); now < end && !is_interrupted(); now = Clock::now())
    std::this_thread::sleep_for(std::min<Clock::duration>(end - now, interruption_delay));
}

}  // namespace splatvol
