"""A DBC as users have them: other frames, other units, Motorola and multiplexed signals; and how it is mapped."""

from __future__ import annotations

from positioner.wire.settings import MessageSettings, WireSettings

USER_DBC = """VERSION ""
NS_ :
BS_:
BU_: PLC VALVE

BO_ 2566834688 Travel: 6 VALVE
 SG_ Alive : 3|4@0+ (1,0) [0|15] "" PLC
 SG_ Travel : 15|16@0+ (0.01,-10) [-10|110] "%" PLC
 SG_ Health : 24|8@1+ (1,0) [0|0] "" PLC
 SG_ Temperature : 39|16@0- (0.1,0) [-400|1500] "degC" PLC

BO_ 512 Drive: 4 PLC
 SG_ Demand : 7|16@0+ (0.01,0) [0|100] "%" VALVE
 SG_ Alive : 16|4@1+ (1,0) [0|15] "" VALVE
 SG_ Spare : 24|8@1+ (1,-40) [-40|215] "" VALVE

BO_ 513 Pressure: 4 VALVE
 SG_ Supply : 0|32@1- (1,0) [0|0] "bar" PLC

BO_ 514 Target: 2 PLC
 SG_ Target : 0|16@1- (-0.01,0) [-100|100] "mm" VALVE

BO_ 515 Wide: 16 VALVE
 SG_ Travel : 0|16@1+ (0.01,0) [0|100] "mm" PLC

BO_ 516 Mixed: 8 VALVE
 SG_ Page M : 0|8@1+ (1,0) [0|3] "" PLC
 SG_ Travel m0 : 8|16@1+ (0.01,0) [0|100] "mm" PLC

BO_ 517 Tail: 4 PLC
 SG_ Target : 0|16@1+ (0.01,0) [0|100] "mm" VALVE
 SG_ Signed : 16|4@1- (1,0) [0|0] "" VALVE
 SG_ Scaled : 20|4@1+ (0.5,0) [0|0] "" VALVE

BA_DEF_ SG_ "GenSigStartValue" FLOAT 0 65535;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "GenSigStartValue" SG_ 512 Spare 60;
SIG_VALTYPE_ 513 Supply : 1;
"""

ALL = WireSettings(
    stem_position=MessageSettings(
        message="Travel", signals={"position_m": "Travel", "quality": "Health"}, counter="Alive"
    ),
    actuator_state=MessageSettings(message="Pressure", signals={"pressure_pa": "Supply"}),
    setpoint=MessageSettings(message="Target", signals={"setpoint_m": "Target"}),
    current_command=MessageSettings(message="Drive", signals={"current_ma": "Demand"}, counter="Alive"),
)
