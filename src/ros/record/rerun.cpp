#include "ros/record/rerun.h"

namespace pliant_ros {

void Rerun::begin(const Step &first)
{
    Data data = create_data(*loaded_->model);
    add_tools(*loaded_->model, data.get(), first.tools);
    data_.swap(data);
    begun_ = true;
}

void Rerun::set_model(std::shared_ptr<const LoadedModel> loaded)
{
    data_.reset(); /* the data refer to the model */
    begun_ = false;
    loaded_ = std::move(loaded);
}

bool Rerun::take(const Step &recorded)
{
    if (recorded.sequence == 1) begin(recorded);
    if (!begun_) {
        ++skipped_;
        return false;
    }
    if (recorded.sequence != 1 && (recorded.sequence != last_.sequence + 1 || recorded.load != last_.load)) {
        begun_ = false;
        throw Failure(PLIANT_ERROR_FORMAT, "after sequence number " + std::to_string(last_.sequence) +
                                               " the recording continues with " + std::to_string(recorded.sequence) +
                                               ": the steps between are missing; replay continues at the next reset");
    }
    const uint32_t recorded_before = last_.revision;
    const uint64_t before = pliant_data_get_body(data_.get())->revision;
    const bool first = recorded.sequence == 1;
    last_ = recorded;
    for (const CutInput &cut : recorded.cuts) {
        pliant_cut_report report;
        make_cut(*loaded_->model, data_.get(), cut, &report);
    }
    set_step_outcome(make_step(*loaded_->model, data_.get(), PLIANT_BACKGROUND_PRESCRIBED, recorded), *data_, &last_);
    ++made_;
    /* revisions are compared by change, because their numbers differ if bodies existed before the reset */
    const bool changed = pliant_data_get_body(data_.get())->revision != before;
    const bool cut_differs = !first && changed != (recorded.revision != recorded_before);
    if (last_.status != recorded.status || last_.step != recorded.step || last_.checksum != recorded.checksum ||
        cut_differs) {
        if (differing_++ == 0) first_differing_ = recorded.step;
    }
    return true;
}

std::shared_ptr<const Snapshot> Rerun::snapshot() const
{
    auto out = std::make_shared<Snapshot>();
    take_snapshot(loaded_, *data_, last_.header.stamp, pliant_model_get_scene(loaded_->model)->output.scalar,
                  out.get());
    out->revision = last_.revision;
    return out;
}

std::string Rerun::summary() const
{
    std::string text = std::to_string(made_) + " steps recomputed, ";
    text += differing_ == 0 ? "each bitwise equal to the recording"
                            : std::to_string(differing_) + " of them differ from the recording, from step " +
                                  std::to_string(first_differing_) + " on";
    if (skipped_ > 0) text += "; " + std::to_string(skipped_) + " before the first reset in the recording";
    return text;
}

} // namespace pliant_ros
