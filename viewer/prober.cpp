#include "viewer/prober.h"

#include <utility>

namespace splatvol {

bool Prober::take_answer() {
  if (!is_busy() || !answer_.wait()) return false;
  Answer answer = answer_.take();
  answered_ = std::move(asked_);
  asked_.reset();
  serial_ = answered_->serial;
  frame_ = std::move(answer.frame);
  cells_ = std::move(answer.cells);
  probe_ = std::move(answer.probe);
  return true;
}

void Prober::ask(const Question& question, const FrameSplats& frame, const DrawingUnits& units,
                 const CellsOf& cells_of) {
  if (is_busy() || answered_ == question) return;
  asked_ = question;
  const bool is_known = frame_ && serial_ == question.serial;
  auto answer = [question, units, cells_of, known = is_known ? frame_ : nullptr, cells = cells_,
                 list = is_known ? DrawList() : frame.list]() mutable -> Answer {
    if (!known) {
      known = std::make_shared<const ProbedFrame>(std::move(list), units);
      cells = ProbedCells::open(cells_of.steps, cells_of.step, cells_of.attribute).value_or(nullptr);
    }
    const auto& factors = question.opacity_function;
    auto probe = known->probe({question.function, factors ? &*factors : nullptr}, question.looking, question.opacity);
    if (probe && cells) cells->take_values(question.looking.ray, *probe);
    return {std::move(known), std::move(cells), std::move(probe)};
  };
  frame_.reset();
  cells_.reset();
  answer_ = {host_, std::move(answer)};
}

const std::optional<Probe>* Prober::answer_to(const Question& question) {
  return answered_ == question ? &probe_ : nullptr;
}

void Prober::forget() {
  if (is_busy()) return;
  frame_.reset();
  cells_.reset();
  answered_.reset();
  probe_.reset();
}

}  // namespace splatvol
