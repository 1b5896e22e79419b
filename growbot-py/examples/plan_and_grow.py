"""Plans a body, shows it, and grows it on the simulated robot."""

import growbot

plan = growbot.plan((0, 0, 0, 0, 90), (20, 10, 160, 0, 80))
positions, directions = plan.sample(100)
print(f"{plan.path_type}: {plan.length_mm:.1f} mm, {plan.layer_count} layers; the tip ends at {positions[-1].round(3)}")

with growbot.connect("sim") as board:
    growth = board.grow(plan, conditions=growbot.Conditions(noise_percent=5))
    for event in growth:
        match event:
            case growbot.events.StateChanged(state=state):
                print(state)
            case growbot.events.LayerLaid(layer=layer) if layer % 50 == 0:
                print("layer", layer)
            case _:
                pass
    result = growth.wait()
print(f"simulated: {result['outcome']}, {result['position_error_mm']:.3f} mm from the goal")
