"""An independent model of the hardware, to check the diagnosis against: it shares no code with physics, rigs or gap."""
